//! What a search comes to.

use crate::detect::Test;
use crate::localise::Place;
use crate::name::Explanation;
use serde::{Deserialize, Serialize};

/// The outcome of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The model explains the data up to their noise.
    NoGap,
    /// One effect explains what the model did not.
    Named,
    /// Several effects explain it, and the data do not tell them apart.
    CannotTellApart,
    /// There is a gap, and no candidate closes it.
    NoneOfThese,
    /// The parameters press on the edges of their priors, and the gap closes where these are opened.
    PriorTooNarrow,
}

impl Verdict {
    /// The name used in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::NoGap => "no_gap",
            Verdict::Named => "named",
            Verdict::CannotTellApart => "cannot_tell_apart",
            Verdict::NoneOfThese => "none_of_these",
            Verdict::PriorTooNarrow => "prior_too_narrow",
        }
    }
}

/// A fitted value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Name with unit.
    pub name: String,
    /// Value at the best fit.
    pub value: f64,
    /// 5 % quantile.
    pub q05: f64,
    /// 95 % quantile.
    pub q95: f64,
}

/// A model, fitted and tested.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fitness {
    /// Values that all episodes share.
    pub estimates: Vec<Estimate>,
    /// The test of the hypothesis that the model explains the data.
    pub test: Test,
    /// Root mean square distance between measured and simulated keypoints over all episodes, mm.
    pub rmse_mm: f64,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// The outcome.
    pub verdict: Verdict,
    /// What each stage came to, in order.
    pub conclusions: Vec<String>,
    /// The present model.
    pub present: Fitness,
    /// Where the present model and the data disagree, part by part.
    pub places: Vec<Place>,
    /// Parameters that press on an edge of their prior.
    pub pressing: Vec<String>,
    /// What each candidate explains, the most probable first; empty where there is no gap.
    pub explanations: Vec<Explanation>,
    /// Candidates that were left out, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Posterior probability that none of the candidates is present; 1 where none was tried.
    pub probability_of_none: f64,
    /// The effects that the verdict speaks of: one where it is named, several that cannot be told apart, else none.
    pub effects: Vec<String>,
    /// The model with the most probable effect.
    pub repaired: Option<Fitness>,
}
