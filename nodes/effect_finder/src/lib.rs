//! Where simulation and measurement disagree, and which effect explains it.
//!
//! Does: fit a model to measured episodes, test whether what is left is more than noise, say where it lies, and compare what
//! each candidate effect would explain.
//! Does not: simulate (it asks `catenary_core::DifferentiableSimulator`), know the effects (it is given candidates), know ROS
//! (the `node` feature does), read files or clocks.

mod black_box;
mod calibrate;
pub mod candidate;
pub mod case;
#[cfg(feature = "node")]
pub mod convert;
pub mod detect;
pub mod detectable;
pub mod discrepancy;
pub mod error;
pub mod evidence;
pub mod find;
pub mod fit;
pub mod hypothesis;
pub mod laplace;
pub mod localise;
pub mod name;
#[cfg(feature = "node")]
pub mod node;
pub mod outcome;
pub mod repair;
mod sentences;
pub mod separate;
pub mod settings;
#[cfg(test)]
mod toy;
pub mod trade_off;
pub mod unknowns;
pub mod verdict;
pub mod verify;

pub use candidate::Candidate;
pub use error::FinderError;
pub use find::{OnProgress, Progress, Question, Stage, find};
pub use outcome::Outcome;
pub use settings::Settings;
pub use verdict::{Finding, Verdict};
