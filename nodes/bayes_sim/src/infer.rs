//! The whole inference: iterations, posterior, and what is to be said about it.

use crate::diagnostics::{self, Predictive};
use crate::error::InferenceError;
use crate::sequential::{Iteration, OnProgress, Sequential, request};
use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::posterior::Marginal;
use catenary_core::{Model, Policy, Posterior, SimulationRequest, Simulator, seed};
use serde::{Deserialize, Serialize};

/// Draws behind the share of the mixture that lies outside the prior's support.
const MASS_DRAWS: usize = 10_000;
/// Random streams of the last steps, beyond those of the iterations.
const PREDICTIVE_STREAM: u64 = 101;
const MASS_STREAM: u64 = 102;

/// What an inference gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InferenceResult {
    /// The posterior.
    pub posterior: Posterior,
    /// Its marginals, in the parameters' units.
    pub marginals: Vec<Marginal>,
    /// What each iteration did.
    pub iterations: Vec<Iteration>,
    /// Share of the untruncated mixture that lies outside the prior's support.
    pub mass_outside: f64,
    /// How well the posterior predicts the measured track; none where no draws were asked for.
    pub predictive: Option<Predictive>,
    /// What should make one doubt.
    pub warnings: Vec<String>,
}

impl InferenceResult {
    /// Simulations in all, without those of the posterior's check.
    pub fn simulations(&self) -> usize {
        self.iterations.last().map_or(0, |i| i.simulations)
    }

    /// Effective sample size of the last iteration's weights.
    pub fn effective_sample_size(&self) -> f64 {
        self.iterations.last().map_or(0.0, |i| i.effective_sample_size)
    }

    /// Held-out loss after each iteration, nat.
    pub fn losses(&self) -> Vec<f64> {
        self.iterations.iter().map(|i| i.loss).collect()
    }
}

/// Infers the posterior over the parameters of `model` from `measured`. `policy` is the one that the episode ran, where the
/// model drives by policy.
pub fn infer(
    model: &Model,
    measured: &MeasuredTrack,
    policy: Option<&Policy>,
    settings: &Settings,
    simulator: &dyn Simulator,
    on_progress: OnProgress<'_>,
) -> Result<InferenceResult, InferenceError> {
    let (template, frames) = request(model, measured, policy, settings.fidelity)?;
    let mut sequential = Sequential::new(&model.theta, &measured.track, frames, settings)?;
    let (mut iterations, mut posterior) = (Vec::new(), Posterior::prior(model.theta.clone()));
    for _ in 0..settings.iterations {
        let (iteration, newest) = sequential.step(&template, simulator, on_progress)?;
        iterations.push(iteration);
        posterior = newest;
    }
    let number = iterations.len();
    let failed = |source| InferenceError::Posterior { iteration: number, source };
    let mass_outside = posterior.mixture.mass_outside(MASS_DRAWS, &mut seed::rng(settings.seed, MASS_STREAM));
    let predictive = match settings.predictive_draws {
        0 => None,
        draws => {
            let check = SimulationRequest {
                thetas: posterior.sample(draws, seed::derive(settings.seed, PREDICTIVE_STREAM)).map_err(failed)?,
                seed: seed::derive(settings.seed, PREDICTIVE_STREAM + 1),
                ..template
            };
            let tracks = simulator.simulate(&check)?;
            diagnostics::predictive(&measured.track, &tracks, &model.camera.view)
        }
    };
    let marginals = posterior.marginals().map_err(failed)?;
    let mut warnings = diagnostics::edges(&posterior).map_err(failed)?;
    let effective = iterations.last().map_or(0.0, |i| i.effective_sample_size);
    warnings.extend(diagnostics::doubts(mass_outside, effective, predictive.as_ref()));
    Ok(InferenceResult { posterior, marginals, iterations, mass_outside, predictive, warnings })
}
