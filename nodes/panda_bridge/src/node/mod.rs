//! The ROS side: an arm's front as the contract has it, and the relay to a controller behind it.

mod controller;
pub mod front;
mod parameters;
mod relay;
mod settings;

pub use relay::main;
