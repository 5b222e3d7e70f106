#![doc = include_str!("../README.md")]

pub mod cell;
#[cfg(feature = "node")]
pub mod convert;
pub mod look;
#[cfg(feature = "node")]
pub mod node;
pub mod render;
pub mod scene;

pub use cell::Cell;
