//! `catenary launch` and `catenary status`: a subset of ROS 2's XML launch files with ROS 2's meaning, and the processes that
//! they describe.
//!
//! `reader` turns a launch file into a list of processes without starting any. `supervision` starts the processes, watches
//! them, restarts them on request, and ends them in order.

pub mod args;
pub mod command;
mod description;
mod reader;
pub mod status;
mod supervision;

pub use description::Process;
pub use reader::read;
pub use supervision::Supervisor;
pub use supervision::logs::running_launch;
