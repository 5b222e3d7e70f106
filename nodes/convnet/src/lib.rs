#![doc = include_str!("../README.md")]

mod adam;
mod kernels;
mod net;
mod pass;
mod train;

pub use adam::Adam;
pub use net::{Layer, Net, NetError, Shape};
pub use pass::Pass;
pub use train::{Sample, batch_gradient};
