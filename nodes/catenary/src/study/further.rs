//! Policies of a study beside U and those of the posteriors.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// Policies that a study may do without.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Further {
    /// For the middle of the prior
    Mu,
    /// An oracle for each object, which knows the hidden values
    Told,
}
