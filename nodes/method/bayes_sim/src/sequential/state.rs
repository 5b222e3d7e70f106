//! State from which an inference continues after its process was killed.

use super::iteration::Iteration;
use crate::network::{Ensemble, Samples};
use catenary_core::{Mixture, ParameterSpace};
use serde::{Deserialize, Serialize};

/// Version of the state's format.
const VERSION: u32 = 1;

/// State after a number of iterations. Everything else follows from the settings and the seed: an inference that continues
/// from here ends with the bits of an uninterrupted one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    version: u32,
    /// Identity of the inference: model, recordings, settings and program.
    #[serde(rename = "question")]
    pub(super) fingerprint: u64,
    /// Samples with usable tracks, over the unit coordinates of the next iteration's support.
    pub(super) samples: Samples,
    /// Number of thetas simulated.
    pub(super) simulations: usize,
    /// Account of each iteration.
    pub(super) iterations: Vec<Iteration>,
    /// Posterior after each iteration, over the unit coordinates of its own support.
    pub(super) posteriors: Vec<Mixture>,
    /// Parameters with the support of the iteration after each iteration; empty if the setting fixes the support.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) supports: Vec<ParameterSpace>,
    /// Networks after the last iteration.
    pub(super) ensemble: Ensemble,
}

impl State {
    /// State before the first iteration.
    pub(crate) fn new(fingerprint: u64, samples: Samples) -> Self {
        let (iterations, posteriors, ensemble) = (Vec::new(), Vec::new(), Ensemble::default());
        let supports = Vec::new();
        Self { version: VERSION, fingerprint, samples, simulations: 0, iterations, posteriors, supports, ensemble }
    }

    /// Accounts of the iterations made.
    pub fn iterations(&self) -> &[Iteration] {
        &self.iterations
    }

    /// Number of thetas simulated.
    pub fn simulations(&self) -> usize {
        self.simulations
    }

    /// Posterior after the last iteration, over the unit coordinates of that iteration's support.
    pub fn newest(&self) -> Option<&Mixture> {
        self.posteriors.last()
    }

    /// Returns true if the state belongs to the inference with this `fingerprint` and has the current format.
    pub fn belongs_to(&self, fingerprint: u64) -> bool {
        self.version == VERSION && self.fingerprint == fingerprint
    }
}
