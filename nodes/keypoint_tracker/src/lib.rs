//! Label mask to keypoints of the deformable object and the target.
//!
//! Does: the trait [`KeypointTracker`], and its implementation by geometry, [`GeometricTracker`].
//! Does not: know ROS (the `node` feature does), segment images, remember earlier masks, or hold on to keypoints that are
//! no longer seen.
//!
//! Pixel coordinates: u to the right, v down, the centre of the first pixel at (0.5, 0.5).

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;

mod chain;
mod distance;
mod error;
mod geometric_tracker;
mod graph;
mod params;
mod pieces;
mod polyline;
mod strand;
mod target;
mod thinning;
mod tracker;
mod trail;

pub use error::Error;
pub use geometric_tracker::GeometricTracker;
pub use params::{PathStart, TrackerParams};
pub use tracker::KeypointTracker;

#[cfg(test)]
mod drawing;
