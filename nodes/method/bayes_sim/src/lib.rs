#![doc = include_str!("../README.md")]

pub mod calibration;
#[cfg(feature = "node")]
pub mod convert;
pub mod diagnostics;
pub mod dispatch;
pub mod embedding;
pub mod error;
mod fingerprint;
pub mod infer;
pub mod network;
#[cfg(feature = "node")]
pub mod node;
pub mod prediction;
mod prior_support;
mod refinement;
pub mod sequential;
pub mod settings;
mod unit_map;
mod widening;

pub use diagnostics::Predictive;
pub use error::InferenceError;
pub use fingerprint::fingerprint;
pub use infer::{InferenceResult, infer};
pub use prediction::{Prediction, Unseen};
pub use prior_support::{PriorSupport, SupportRule};
pub use refinement::{Fitted, Refinement};
pub use settings::{Settings, SettingsError};
pub use widening::Widening;
