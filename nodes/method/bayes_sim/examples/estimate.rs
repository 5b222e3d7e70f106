//! Training of the networks on plain rows: reads a JSON problem from stdin and writes a JSON answer to stdout. The benchmark
//! against the estimators of `sbi` runs it.

use bayes_sim::network::{Ensemble, Samples, Shape, Training};
use bayes_sim::{Settings, settings};
use catenary_core::{Mixture, ParameterSpace, Posterior, seed};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::error::Error;
use std::ops::ControlFlow;

/// Training data, and the observations at which the posterior is evaluated.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Problem {
    /// Parameters with their priors.
    parameters: ParameterSpace,
    /// N thetas of D numbers, in the parameters' units.
    thetas: Vec<Vec<f64>>,
    /// N rows of X numbers, simulated at the thetas.
    rows: Vec<Vec<f32>>,
    /// Rows at which the posterior is evaluated.
    observations: Vec<Vec<f32>>,
    /// Thetas behind the observations.
    truths: Vec<Vec<f64>>,
    /// Number of draws from each posterior.
    draws: usize,
    /// Seed of the training and of the draws.
    seed: u64,
    /// Fields of the settings that replace the default preset's.
    settings: Map<String, Value>,
}

/// Posteriors at the observations.
#[derive(Serialize)]
struct Answer {
    epochs: usize,
    held_out_loss: f64,
    /// For each observation, the log density in the parameters' units at its truth.
    log_probabilities: Vec<f64>,
    /// For each observation, the draws.
    draws: Vec<Vec<Vec<f64>>>,
}

/// Replaces fields of `under` by those of `over`, and fields of the schedule one by one.
fn merge(under: &mut Value, over: Map<String, Value>) {
    for (name, value) in over {
        match value {
            Value::Object(fields) if name == "schedule" => merge(&mut under[name], fields),
            value => under[name] = value,
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let problem: Problem = serde_json::from_reader(std::io::stdin().lock())?;
    let mut settings = serde_json::to_value(settings::Settings::default())?;
    merge(&mut settings, problem.settings);
    let settings: Settings = serde_json::from_value(settings)?;
    settings.check()?;
    let space = problem.parameters;
    let (n, d) = (problem.thetas.len(), space.dimension());
    let width = problem.rows.first().map_or(0, Vec::len);
    let units = problem.thetas.iter().flat_map(|t| space.to_unit(t)).collect();
    let samples = Samples::of_rows(problem.rows.concat(), width, units, d);
    let shape = Shape::of_samples(&samples, &settings);
    let (weights, split_keys) = (vec![1.0; n], (0..n).collect::<Vec<_>>());
    let seeds = [1, 2].map(|stream| seed::derive(problem.seed, stream));
    let training = Training {
        data: &samples,
        weights: &weights,
        split_keys: &split_keys,
        seed: seeds[0],
        held_out_seed: seeds[1],
    };
    let (ensemble, outcome) =
        Ensemble::train(&shape, &settings, None, training, &mut |_, _| ControlFlow::Continue(()))?;
    let (mut draws, mut log_probabilities) = (Vec::new(), Vec::new());
    for (row, truth) in problem.observations.iter().zip(&problem.truths) {
        let observed = Samples::of_rows(row.clone(), width, vec![0.5; d], d);
        let mixture: Mixture = ensemble.mixture(&observed)?;
        let outside = mixture.mass_outside(problem.draws, &mut seed::rng(problem.seed, 3));
        let posterior = Posterior { parameters: space.clone(), mixture };
        let volume: f64 = space.parameters().iter().zip(truth).map(|(p, value)| p.prior.density(*value).ln()).sum();
        log_probabilities.push(posterior.log_density_unit(truth) - (1.0 - outside).ln() + volume);
        draws.push(posterior.sample(problem.draws, problem.seed)?);
    }
    let answer = Answer { epochs: outcome.epochs, held_out_loss: outcome.held_out_loss, log_probabilities, draws };
    serde_json::to_writer(std::io::stdout().lock(), &answer)?;
    Ok(())
}
