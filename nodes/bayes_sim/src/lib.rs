//! Likelihood-free inference: BayesSim with an RKHS embedding of keypoint tracks.
//!
//! Does: embed tracks, train a mixture density network on simulated ones, draw anew from what was learnt, say what the
//! posterior is worth, and decide which of several simulators does which episodes.
//! Does not: simulate (it asks `catenary_core::Simulator`), know ROS (the `node` feature does), read files or clocks.

pub mod calibration;
#[cfg(feature = "node")]
pub mod convert;
pub mod diagnostics;
pub mod dispatch;
pub mod embedding;
pub mod error;
pub mod infer;
pub mod network;
#[cfg(feature = "node")]
pub mod node;
pub mod sequential;
pub mod settings;

pub use diagnostics::Predictive;
pub use error::InferenceError;
pub use infer::{InferenceResult, infer};
pub use settings::Settings;
