#![doc = include_str!("../README.md")]

pub mod data;
pub mod error;
pub mod evidence;
pub mod fitting;
#[cfg(feature = "node")]
pub mod node;
pub mod report;
pub mod search;
pub mod settings;
pub mod toy;

pub use data::Candidate;
pub use error::FinderError;
pub use report::{Finding, Outcome, Verdict};
pub use search::{OnProgress, Progress, Question, Stage, find};
pub use settings::Settings;
