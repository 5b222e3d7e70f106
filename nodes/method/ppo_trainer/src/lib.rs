#![doc = include_str!("../README.md")]

pub mod adam;
#[cfg(feature = "node")]
pub mod convert;
pub mod curve;
pub mod domains;
pub mod loss;
pub mod network;
#[cfg(feature = "node")]
pub mod node;
pub mod normaliser;
pub mod plan_search;
pub mod rollout;
pub mod schedule;
pub mod settings;
pub mod state;
pub mod trainer;

pub use curve::{CurvePoint, Rise};
pub use domains::Domains;
pub use settings::{Settings, SettingsError};
pub use state::{State, StateError};
pub use trainer::{Progress, TrainError, Trained, train, train_from};
