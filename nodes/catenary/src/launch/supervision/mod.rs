//! Processes of a launch: their start, table, logs and end, and the check for a running graph before the start.

pub mod logs;
pub mod neighbours;
mod supervisor;
pub mod table;
#[cfg(test)]
mod tests;
mod watched;

pub use supervisor::Supervisor;
