//! Errors.

use thiserror::Error;

/// Why there is no mask.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum Error {
    /// A parameter is out of range.
    #[error("{field}: expected {expected}, got {got}")]
    Parameter {
        /// The parameter's name.
        field: &'static str,
        /// What values it may take.
        expected: &'static str,
        /// The value given.
        got: String,
    },
    /// The image of a message does not fit.
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
    /// Field or property at fault, by which dropped images are counted.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Parameter { field, .. } | Self::Image { field, .. } => field,
            Self::CropOutside { .. } => "size",
        }
    }
}
