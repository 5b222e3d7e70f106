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
}
