#![doc = include_str!("../README.md")]

mod adam;
mod builder;
mod descent;
mod kernels;
mod net;
mod pass;
mod schedule;
mod train;
mod weights;

pub use adam::Adam;
pub use builder::Builder;
pub use descent::{Descent, Progress, Stopped, TrainingSettings, descend};
pub use net::{Layer, Net, NetError, Shape};
pub use pass::Pass;
pub use train::{Sample, batch_gradient, mean_gradient};
pub use weights::{WeightsError, bytes_of, weights_of};
