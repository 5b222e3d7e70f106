//! Segmentation by a trained network, for any object: it takes the object's colour from a click as input.

mod frame;
pub mod generator;
mod network;
mod segmenter;
mod size;
mod training;

pub use convnet::{Descent, Progress, Stopped, TrainingSettings, bytes_of};
pub use frame::LabelledFrame;
pub use network::{Clicked, Weights, network, shipped_weights, weights_of};
pub use segmenter::{LearnedParams, LearnedSegmenter};
pub use size::SIDE;
pub use training::{SHIPPED_TRAINING, Start, train};
