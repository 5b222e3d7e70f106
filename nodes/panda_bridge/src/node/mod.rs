//! ROS 2 side: the front end of an arm, and the relay to a controller.

mod controller;
pub mod front;
mod parameters;
mod relay;
mod settings;

pub use relay::main;
