#![doc = include_str!("../README.md")]

pub mod data;
pub mod design;
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
