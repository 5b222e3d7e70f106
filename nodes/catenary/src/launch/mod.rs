//! Launch files: ROS 2's XML form, as far as the shipped files use it, and the processes they describe.
//!
//! `file` reads a launch file into a list of processes, without starting any; `supervisor` starts them, watches them,
//! restarts those that ask for it, and ends them in order.

pub mod command;
pub mod file;
mod substitution;
pub mod supervisor;

pub use file::{LaunchDescription, Process, read};
pub use supervisor::Supervisor;
