//! Errors of segmentation.

use thiserror::Error;

/// Reason for which an image gave no mask.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum Error {
    /// A parameter is out of range.
    #[error("{field}: expected {expected}, got {got}")]
    Parameter {
        /// Name of the parameter.
        field: &'static str,
        /// Values that it may take.
        expected: &'static str,
        /// Value that was given.
        got: String,
    },
    /// An image message cannot be read.
    #[error("{field}: expected {expected}, got {got}")]
    Image {
        /// Field of the message.
        field: &'static str,
        /// Expected value.
        expected: &'static str,
        /// Received value.
        got: String,
    },
    /// The crop does not lie within the image.
    #[error(
        "crop: expected a square within the image of {width} x {height} pixels, got side {side_px} px at ({left_px}, {top_px})"
    )]
    CropOutside {
        /// Width of the image in pixels.
        width: u32,
        /// Height of the image in pixels.
        height: u32,
        /// Left edge of the crop in image pixels.
        left_px: f64,
        /// Upper edge of the crop in image pixels.
        top_px: f64,
        /// Side of the crop in image pixels.
        side_px: f64,
    },
}

impl Error {
    /// Field or property at fault. The node counts dropped images by it.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Parameter { field, .. } | Self::Image { field, .. } => field,
            Self::CropOutside { .. } => "size",
        }
    }
}
