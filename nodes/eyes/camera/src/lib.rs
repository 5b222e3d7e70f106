#![doc = include_str!("../README.md")]

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;
#[cfg(feature = "node")]
pub mod picture;

mod backend;
mod colour_fit;
mod colour_segmenter;
mod encoding;
mod error;
pub mod learned;
mod light_reference;
mod params;
mod segmenter;
mod selection;
mod sight;
pub mod yolo;

pub use backend::{Backend, SegmenterParams};
pub use colour_fit::{ColourFit, colour_of_clicks, colour_of_labels, fit_colours, pixels_of_clicks};
pub use colour_segmenter::ColourSegmenter;
pub use encoding::{Converter, EncodedView, Encoding};
pub use error::Error;
pub use light_reference::LightReference;
pub use params::{ColourParams, ColourRange, Crop};
pub use segmenter::{SegmentationReport, Segmenter};
pub use sight::{Sight, Summary};

#[cfg(test)]
mod scene;
