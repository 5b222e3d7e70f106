//! Implausible samples: a hand and an object move at finite speeds, in metres, near the arm.

mod chain;
mod edges;
mod hand;
mod held;
mod length;
mod object;
mod repeats;
mod spikes;
#[cfg(test)]
mod tests;
mod wrench;

pub(super) use chain::{MOST_LEFT_OUT, at, seconds};
pub use hand::MeasuredPose;
pub(super) use hand::{HandLimits, POSES, observations, poses};
pub(super) use held::without_held;
pub(super) use length::of_usual_length;
pub(super) use object::{KEYPOINTS, keypoints, zero_warning};
pub use repeats::{HeldRun, HeldSummary, PlacedFrame, held_runs, held_summaries};
pub(super) use wrench::{WRENCHES, wrenches};
