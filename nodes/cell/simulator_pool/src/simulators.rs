//! Cache of the simulators that were built last, for further requests of their models. The one that was built first is
//! dropped first.

use catenary_core::ModelError;
use catenary_simulator::parameters::ParameterError;
use catenary_simulator::{BeamSimulator, fingerprint, model_text};
use std::sync::Arc;
use thiserror::Error;

/// Number of simulators kept for further requests of their models.
const KEPT_SIMULATORS: usize = 4;

/// Error of a model file that makes no simulator.
#[derive(Debug, Error)]
pub enum SimulatorsError {
    /// Model file that cannot be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Model from whose parameters no object can be built.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
}

/// Simulator kept from an earlier request.
struct Kept {
    yaml: String,
    workers: usize,
    simulator: Arc<BeamSimulator>,
    fingerprint: u64,
}

/// Numbers of time steps and initial shapes that did not converge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unconverged {
    /// Time steps.
    pub steps: u64,
    /// Initial shapes at rest.
    pub equilibria: u64,
}

impl Unconverged {
    /// Returns the numbers of all batches of a simulator so far.
    pub fn of(simulator: &BeamSimulator) -> Self {
        Self { steps: simulator.unconverged_steps(), equilibria: simulator.unconverged_equilibria() }
    }

    fn plus(self, other: Self) -> Self {
        Self { steps: self.steps + other.steps, equilibria: self.equilibria + other.equilibria }
    }
}

/// Simulators of the newest requests.
#[derive(Default)]
pub struct Simulators {
    kept: Vec<Kept>,
    /// Unconverged counts of the simulators that are no longer kept.
    unconverged_before: Unconverged,
}

impl Simulators {
    /// Returns the simulator of a model file's text with `workers` threads, and its fingerprint. An earlier request's
    /// simulator is used again.
    ///
    /// # Errors
    /// [`SimulatorsError`] if the text is no model, or the model makes no object.
    pub fn get(&mut self, yaml: &str, workers: usize) -> Result<(Arc<BeamSimulator>, u64), SimulatorsError> {
        if let Some(kept) = self.kept.iter().find(|kept| kept.yaml == yaml && kept.workers == workers) {
            return Ok((Arc::clone(&kept.simulator), kept.fingerprint));
        }
        let model = model_text::read(yaml)?;
        let (simulator, fingerprint) = (Arc::new(BeamSimulator::new(&model, workers)?), fingerprint(&model));
        if self.kept.len() == KEPT_SIMULATORS {
            // The oldest goes first. Its counts stay in the totals.
            let gone = Unconverged::of(&self.kept.remove(0).simulator);
            self.unconverged_before = self.unconverged_before.plus(gone);
        }
        self.kept.push(Kept { yaml: yaml.to_owned(), workers, simulator: Arc::clone(&simulator), fingerprint });
        Ok((simulator, fingerprint))
    }

    /// Returns the unconverged counts of all requests so far.
    pub fn unconverged(&self) -> Unconverged {
        let kept = self.kept.iter().map(|kept| Unconverged::of(&kept.simulator));
        kept.fold(self.unconverged_before, Unconverged::plus)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");

    #[test]
    fn a_change_of_workers_reaches_the_next_batch() {
        let mut simulators = Simulators::default();
        let (one, fingerprint) = simulators.get(SOFT_BAR, 1).unwrap();
        assert!(Arc::ptr_eq(&one, &simulators.get(SOFT_BAR, 1).unwrap().0), "the same request builds nothing anew");
        let (two, same) = simulators.get(SOFT_BAR, 2).unwrap();
        assert!(!Arc::ptr_eq(&one, &two) && same == fingerprint, "bits do not depend on the workers");
    }
}
