//! Setting for a prior's support that is too narrow.

use serde::{Deserialize, Serialize};

/// Treatment of the prior's support during an inference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PriorSupport {
    /// The support stays that of the model file.
    Fixed,
    /// A rule moves the support between iterations, within the physical limits that the simulator knows. The posterior
    /// carries the support of the last iteration.
    Adaptive(SupportRule),
}

/// Rule by which the support moves. The names are those of Kamaras, Innes and Ramamoorthy 2025 ("Heuristic adaptation of
/// potentially misspecified domain support for likelihood-free inference in stochastic dynamical systems"); the formulas
/// (see `sequential::support`) are this crate's own reading of the abstract.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SupportRule {
    /// The support grows beyond an edge on which the posterior presses.
    Edge,
    /// The support grows towards the side to which the posterior's mode moved, by the distance of this move.
    Mode,
    /// The support keeps its width and moves until the posterior's mode is its centre.
    Centre,
}

impl SupportRule {
    /// All rules.
    pub const ALL: [SupportRule; 3] = [SupportRule::Edge, SupportRule::Mode, SupportRule::Centre];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            SupportRule::Edge => "edge",
            SupportRule::Mode => "mode",
            SupportRule::Centre => "centre",
        }
    }
}

impl PriorSupport {
    /// Support that grows where the posterior presses on an edge. It is the one rule that leaves a support alone on which
    /// nothing presses: the posterior is then that of [`PriorSupport::Fixed`], to the bit.
    pub const ADAPTIVE: PriorSupport = PriorSupport::Adaptive(SupportRule::Edge);

    /// Names in goals, parameters and options.
    pub const NAMES: [&str; 2] = ["fixed", "adaptive"];

    /// Setting with this name; none if no setting has it.
    pub fn from_name(name: &str) -> Option<Self> {
        let [fixed, adaptive] = Self::NAMES;
        match name {
            _ if name == fixed => Some(PriorSupport::Fixed),
            _ if name == adaptive => Some(PriorSupport::ADAPTIVE),
            _ => None,
        }
    }
}
