//! Account of one iteration.

use super::support::SupportMove;
use serde::{Deserialize, Serialize};

/// Account of one iteration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Iteration {
    /// Number of the iteration, from 1.
    pub iteration: usize,
    /// Number of thetas simulated so far, each in every measured episode.
    pub simulations: usize,
    /// Number of thetas in the training, held-out ones included.
    pub tracks: usize,
    /// Number of thetas so far with an unusable track.
    pub unusable: usize,
    /// Mean over the networks of the held-out negative log density in nat, in unit coordinates, of the inflated mixtures
    /// truncated to the prior's support.
    pub loss: f64,
    /// Effective sample size of the importance weights.
    pub effective_sample_size: f64,
    /// Share of the prior's volume in the proposal's support.
    pub proposal_volume: f64,
    /// Passes over the tracks, summed over the networks.
    pub epochs: usize,
    /// Moves of the prior's support after the iteration; the next one draws from the moved prior.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moves: Vec<SupportMove>,
}
