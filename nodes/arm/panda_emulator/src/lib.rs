#![doc = include_str!("../README.md")]

pub mod fci;
#[cfg(feature = "node")]
pub mod node;
mod panda;
pub mod server;
pub mod wire;

pub use panda::{EndEffector, PANDA_URDF, Panda, READY_RAD, Settings, SettingsError, Wall};
