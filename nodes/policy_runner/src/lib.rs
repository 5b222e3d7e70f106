//! One episode of a policy against the topics of the contract.
//!
//! Does: decide, from the newest keypoints and pose, what the policy saw, what it does, where the arm shall go, what the
//! step was worth, and when the episode ends.
//! Does not: read clocks or topics, judge commands (the bridge's gate does), train.

#[cfg(feature = "node")]
pub mod convert;
#[cfg(feature = "node")]
pub mod node;
pub mod numbering;
pub mod runner;

pub use runner::{Fault, Inputs, Objection, Runner, RunnerError, Settings, Step, Turn};
