//! Verdict of a search.

use serde::{Deserialize, Serialize};

/// Verdict of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The model explains the data up to their noise.
    NoGap,
    /// The stated noise is larger than what the recordings show, and the noise itself cannot be told from them: a gap may hide in
    /// the difference.
    CannotSee,
    /// One effect, or several together, close the gap.
    Named,
    /// Several explanations close the gap, and the data do not tell them apart.
    CannotTellApart,
    /// The gap stays: no candidate closes it, the best one is a stand-in, a template explains the data better, or episodes
    /// that no fit saw refute the repair. Effects that explain its greater part and leave a residual are the nearest ones, and
    /// are not named.
    NoneOfThese,
    /// The gap closes beyond the prior of a parameter, or of a value of an episode, at its bound. Effects that close it within the priors are listed
    /// as alternatives.
    PriorTooNarrow,
}

impl Verdict {
    /// Name of the verdict in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::NoGap => "no_gap",
            Verdict::CannotSee => "cannot_see",
            Verdict::Named => "named",
            Verdict::CannotTellApart => "cannot_tell_apart",
            Verdict::NoneOfThese => "none_of_these",
            Verdict::PriorTooNarrow => "prior_too_narrow",
        }
    }
}
