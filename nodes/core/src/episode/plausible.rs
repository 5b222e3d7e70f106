//! Implausible samples: a hand and an object move at finite speeds, in metres, near the arm.

mod chain;
mod edges;
mod hand;
mod object;
mod spikes;
#[cfg(test)]
mod tests;

pub(super) use chain::seconds;
pub use hand::MeasuredPose;
pub(super) use hand::{HandLimits, POSES, observations, poses};
pub(super) use object::{KEYPOINTS, keypoints};
