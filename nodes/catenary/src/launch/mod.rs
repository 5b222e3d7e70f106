//! Launch files: a part of ROS 2's XML form, with ROS 2's meaning, and the processes they describe.
//!
//! `file` reads a launch file into a list of processes, without starting any; `supervisor` starts them, watches them,
//! restarts those that ask for it, and ends them in order.

pub mod command;
mod description;
mod element;
mod file;
mod functions;
mod namespace;
mod neighbours;
mod package;
mod parameter;
mod process;
mod python;
pub mod status;
mod substitution;
mod supervisor;
mod table;
#[cfg(test)]
mod tests;
mod value;
mod watched;

pub use description::Process;
pub use file::read;
pub use supervisor::Supervisor;
