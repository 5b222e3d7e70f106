//! Image to label mask: where the deformable object and the target are.
//!
//! Does: the trait [`Segmenter`], and its implementation by colour, [`ColourSegmenter`].
//! Does not: read a camera, know ROS (the `node` feature does), find keypoints, or guess what an occluder hides: the
//! mask labels what is seen.

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;

mod classify;
mod colour_segmenter;
mod error;
mod morphology;
mod occlusion;
mod params;
mod segmenter;
mod vote;

pub use colour_segmenter::ColourSegmenter;
pub use error::Error;
pub use params::{ColourParams, ColourRange, Crop};
pub use segmenter::{SegmentationReport, Segmenter};

#[cfg(test)]
mod scene;
