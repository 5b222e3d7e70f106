//! Episodes, assembled from the stamped records of the topics.
//!
//! A bag reader and a live subscription feed the same [`EpisodeLog`]. Its episodes depend on the records alone, and not
//! on the order in which they arrive.

mod complete;
mod coverage;
mod error;
mod log;
mod measured;
mod plausible;
mod start;
#[cfg(test)]
mod tests;

pub use complete::{Episode, EpisodeStart};
pub use error::EpisodeError;
pub use log::{EpisodeLog, RecordKind, is_base_frame};
pub use measured::MeasuredTrack;
pub use plausible::MeasuredPose;
pub use start::order_from;
