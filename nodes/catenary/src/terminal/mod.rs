//! Output of commands: results, messages and progress.

pub mod output;
pub mod progress;
pub mod training;
