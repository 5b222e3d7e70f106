//! Effect: description, and action on the settings of an episode.

use crate::episode_model::EpisodeModel;
use catenary_core::{Model, Prior};

/// Part of the simulator in which an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hook {
    /// Force on the object from outside: air, table, gravity, added mass.
    Force,
    /// Material of the object.
    Material,
    /// Grip: how the object is held.
    Boundary,
    /// Arm: how it follows its commands. Inactive if a measured path moves the grip.
    Actuation,
    /// Camera: how the object is seen.
    Observation,
}

impl Hook {
    /// Returns the name in printed lists.
    pub fn name(self) -> &'static str {
        match self {
            Hook::Force => "force",
            Hook::Material => "material",
            Hook::Boundary => "boundary",
            Hook::Actuation => "actuation",
            Hook::Observation => "observation",
        }
    }
}

/// Sign of an effect's magnitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sign {
    /// Zero or positive.
    Positive,
    /// Positive or negative.
    Signed,
}

/// Description of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct About {
    /// Name with unit, as model files write it.
    pub name: &'static str,
    /// Name in a sentence.
    pub title: &'static str,
    /// Consequence of a larger magnitude.
    pub description: &'static str,
    /// Unit of the magnitude; 1 for a share or a coefficient.
    pub unit: &'static str,
    /// Part of the simulator in which it acts.
    pub hook: Hook,
    /// Prior of the magnitude if the effect is present. Its support reaches from magnitudes that hardly show in a track to
    /// magnitudes that are clearly too large.
    pub prior: Prior,
    /// Smallest and largest sensible magnitude. Zero lies within.
    pub range: [f64; 2],
}

impl About {
    /// Returns the sign that the magnitude may have.
    pub fn sign(&self) -> Sign {
        if self.range[0] < 0.0 { Sign::Signed } else { Sign::Positive }
    }
}

/// Effect: a way in which reality may differ from the base simulator.
pub trait Effect: Send + Sync {
    /// Returns the description.
    fn about(&self) -> About;

    /// Adds the effect with a magnitude to the episode settings, on top of the effects there.
    ///
    /// # Errors
    /// The part of the model that is missing, if the effect has nothing to act on.
    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str>;

    /// Returns whether episodes of `model` can have the effect: an effect of a sensor needs a model that observes it.
    fn concerns(&self, model: &Model) -> bool {
        let _ = model;
        true
    }

    /// Returns whether searches offer the effect although the model file does not name it among its prior odds. An effect that imitates
    /// many others does not, so that it is named where it is expected alone.
    fn is_offered_unasked(&self) -> bool {
        true
    }

    /// Returns the names of the effects that set where and how fast this one acts.
    fn companions(&self) -> &[&'static str] {
        &[]
    }

    /// Returns the magnitude that stands for an absent effect. It is zero except for companions.
    fn if_absent(&self) -> f64 {
        0.0
    }
}

/// Uniform prior on `low` to `high`.
pub(super) const fn uniform(low: f64, high: f64) -> Prior {
    Prior::Uniform { low, high }
}

/// Prior uniform in the logarithm on `low` to `high`.
pub(super) const fn log_uniform(low: f64, high: f64) -> Prior {
    Prior::LogUniform { low, high }
}
