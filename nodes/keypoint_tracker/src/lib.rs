#![doc = include_str!("../README.md")]

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;

mod error;
mod geometric_tracker;
mod params;
mod tracker;

pub use error::Error;
pub use geometric_tracker::GeometricTracker;
pub use params::{PathStart, TrackerParams};
pub use tracker::KeypointTracker;

#[cfg(test)]
mod drawing;
