#![doc = include_str!("../README.md")]

pub mod fci;
pub mod panda;
pub mod server;
pub mod wire;

pub use panda::{Panda, Settings, SettingsError};
