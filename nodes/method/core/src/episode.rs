//! Episodes, assembled from the stamped records of the topics.
//!
//! A bag reader and a live subscription feed the same [`EpisodeLog`]. Its episodes depend on the records alone, and not
//! on the order in which they arrive. The order only shows whether a recording passes through a time twice.

mod complete;
mod coverage;
mod error;
mod kept;
mod log;
mod measured;
mod order;
mod plausible;
mod rate;
mod start;
mod stream;
#[cfg(test)]
mod tests;
mod view;

pub use complete::{Episode, EpisodeStart};
pub use error::EpisodeError;
pub use log::{EpisodeLog, RecordKind, is_base_frame};
pub use measured::MeasuredTrack;
pub use order::order_from;
pub use plausible::{HeldRun, HeldSummary, MeasuredPose, PlacedFrame, held_runs, held_summaries};
pub use rate::interval_doubt;
pub use view::{OutOfView, out_of_view, view_of, view_warning};
