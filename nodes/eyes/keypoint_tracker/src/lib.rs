#![doc = include_str!("../README.md")]

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;

pub mod learned;

mod backend;
mod error;
mod geometric_tracker;
mod params;
mod target;
mod tracker;

pub use backend::{Backend, TrackingParams};
pub use error::Error;
pub use geometric_tracker::GeometricTracker;
pub use params::{PathStart, TrackerParams};
pub use tracker::KeypointTracker;
use tracker::check;

#[cfg(test)]
mod drawing;
