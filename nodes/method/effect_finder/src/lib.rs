#![doc = include_str!("../README.md")]

pub mod error;
pub mod evidence;
#[cfg(feature = "node")]
pub mod node;
pub mod report;
pub mod search;
pub mod settings;
pub mod template;

pub use error::FinderError;
pub use report::{Finding, Outcome, Verdict};
pub use search::{OnProgress, Progress, Question, Stage, find};
pub use settings::Settings;
pub use track_fit::data::Candidate;
pub use track_fit::toy;
