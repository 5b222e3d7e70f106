//! Size of an effect.

use serde::{Deserialize, Serialize};

/// Effect with its size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Magnitude {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Name in sentences.
    pub title: String,
    /// Value at the best fit, in the effect's unit.
    pub value: f64,
    /// Standard deviation, all other unknowns free; if a residual is left, with the spread between conditions.
    pub sd: f64,
    /// Companions of the effect; empty for an effect of one number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub companions: Vec<CompanionValue>,
}

/// Companion of an effect with its value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompanionValue {
    /// Name of the companion, with its unit.
    pub name: String,
    /// Name in sentences.
    pub title: String,
    /// Value at the best fit, in the companion's unit.
    pub value: f64,
    /// Lower end of its interval of 90 %, within its prior, all other unknowns free; if a residual is left, with the
    /// spread between conditions.
    pub q05: f64,
    /// Upper end of the interval.
    pub q95: f64,
}
