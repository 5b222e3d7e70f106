//! The running graph as a client: goals of its actions, and the check before a command to its arm.

pub mod arm_law;
pub mod goal;
pub mod one_arm;
pub mod own;
mod pulse;
pub mod request;

use std::time::Duration;

/// Time in which every other node of a domain is found. Discovery on one machine takes less than half a second.
pub const DISCOVERY_TIME: Duration = Duration::from_millis(700);
