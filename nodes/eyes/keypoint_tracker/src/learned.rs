//! Trackers by a trained network, and their training on simulated masks.

mod grid;
mod heat;
mod network;
mod ordered;
mod square;
mod tracker;
mod training;
pub mod view;

mod transporter;

pub use convnet::{Descent, Progress, Stopped, TrainingSettings, bytes_of};
pub use network::{NetworkKind, Weights, shipped_weights, weights_of};
pub use tracker::LearnedTracker;
pub use training::train;
