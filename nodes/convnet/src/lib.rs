#![doc = include_str!("../README.md")]

mod adam;
mod kernels;
mod net;
mod pass;
mod schedule;
mod train;
mod weights;

pub use adam::Adam;
pub use net::{Layer, Net, NetError, Shape};
pub use pass::Pass;
pub use schedule::{clip, rate};
pub use train::{Sample, batch_gradient, mean_gradient};
pub use weights::{WeightsError, bytes_of, weights_of};
