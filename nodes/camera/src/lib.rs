#![doc = include_str!("../README.md")]

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;

mod colour_segmenter;
mod error;
mod params;
mod segmenter;

pub use colour_segmenter::ColourSegmenter;
pub use error::Error;
pub use params::{ColourParams, ColourRange, Crop};
pub use segmenter::{SegmentationReport, Segmenter};

#[cfg(test)]
mod scene;
