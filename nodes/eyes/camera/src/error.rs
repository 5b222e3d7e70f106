//! Errors of segmentation.

use convnet::{Stopped, WeightsError};
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
    /// A click that is on no pixel.
    #[error("click: expected u,v within the image of {width} x {height} pixels, got {got}")]
    Click {
        /// Width of the image in pixels.
        width: u32,
        /// Height of the image in pixels.
        height: u32,
        /// Given place.
        got: String,
    },
    /// An object that colours cannot tell from a grey background.
    #[error(
        "colour of the object: expected a colour, got a grey (median saturation {saturation:.2}, chroma {chroma:.0}); thresholds on colour cannot find it: take the segmenter `learned`, or put paint or a band of colour on it"
    )]
    Colourless {
        /// Median saturation of the object's pixels, 0 to 1.
        saturation: f64,
        /// Median chroma of the object's pixels, 0 to 255.
        chroma: f64,
    },
    /// Labels that do not fit the image, or tell nothing apart.
    #[error(
        "labels: expected one for each of {width} x {height} pixels, some of the object and some not, got {pixels} with {marked} of the object"
    )]
    Labels {
        /// Width of the image in pixels.
        width: u32,
        /// Height of the image in pixels.
        height: u32,
        /// Number of labels.
        pixels: usize,
        /// Number of labels of the object.
        marked: usize,
    },
    /// Weights of another network than that of `catenary train-segmenter`.
    #[error("weights of `catenary train-segmenter` of this version: {0}")]
    Weights(#[from] WeightsError),
    /// A network that is no YOLOv8-seg one, or cannot run.
    #[error("yolo.network: expected {expected}, got {got}")]
    Network {
        /// Needed input, output or class.
        expected: String,
        /// Found one.
        got: String,
    },
    /// A training that ended early.
    #[error(transparent)]
    Training(#[from] Stopped),
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
            Self::Click { .. } => "click",
            Self::Weights(_) => "weights",
            Self::Network { .. } => "network",
            Self::Training(_) => "training",
            Self::Colourless { .. } => "colour",
            Self::Labels { .. } => "labels",
        }
    }
}
