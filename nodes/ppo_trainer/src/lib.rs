//! Proximal policy optimisation (Schulman et al. 2017) over a vectorised environment.
//!
//! Does: train a Gaussian policy through `catenary_core::Env`, from its own forward and backward passes to the policy's
//! file; choose the parameters that environments simulate.
//! Does not: simulate, know ROS (the `node` feature does), read clocks or files. One thread; the same seed gives the same
//! bits.

pub mod adam;
#[cfg(feature = "node")]
pub mod convert;
pub mod domains;
pub mod loss;
pub mod network;
#[cfg(feature = "node")]
pub mod node;
pub mod normaliser;
pub mod rollout;
pub mod settings;
pub mod trainer;

pub use domains::Domains;
pub use settings::{Settings, SettingsError};
pub use trainer::{CurvePoint, Progress, TrainError, Trained, train};
