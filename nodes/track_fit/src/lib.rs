#![doc = include_str!("../README.md")]

pub mod data;
mod differences;
pub mod error;
pub mod fitting;
pub mod noise;
pub mod sampling;
pub mod settings;
pub mod toy;

pub use differences::Differences;
pub use error::FitError;
pub use settings::Settings;
