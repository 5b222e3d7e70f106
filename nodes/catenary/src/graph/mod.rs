//! The running graph as a client: goals of its actions, and the check before a command to its arm.

pub mod goal;
pub mod one_arm;
pub mod request;
