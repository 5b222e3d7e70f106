#![doc = include_str!("../README.md")]

#[cfg(feature = "node")]
mod convert;
pub mod environments;
#[cfg(feature = "node")]
pub mod node;
pub mod simulators;
