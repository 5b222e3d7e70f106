//! Training of the networks on simulated views.

use super::network::{NetworkKind, Weights};
use super::ordered::Labelled;
use super::transporter::{Nets, Pair};
use super::view::{ObjectView, Rollout};
use crate::Error;
use catenary_core::seed;
use convnet::{Adam, Pass, clip, mean_gradient, rate};

/// Stream of random numbers of the first weights.
const START: u64 = u64::MAX;

/// Sizes of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingSettings {
    /// Number of steps.
    pub steps: usize,
    /// Samples of a step.
    pub batch: usize,
    /// Greatest rate of Adam. It rises over the first 5 % of the steps, and falls to zero as a cosine.
    pub rate: f32,
    /// Number of threads.
    pub threads: usize,
    /// Seed of the samples and of the first weights.
    pub seed: u64,
}

/// State of a training after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Number of steps that are done.
    pub step: usize,
    /// Mean loss of the step's samples.
    pub loss: f64,
}

/// Trains a network on views of simulated objects. `tell` is called after each step, and ends the training with an error if it returns
/// false.
///
/// # Errors
/// [`Error::Interrupted`]; [`Error::Parameter`] without steps or views, for a view that is no line, or for a loss that is not finite.
pub fn train(
    kind: NetworkKind,
    settings: &TrainingSettings,
    rollouts: &[Rollout],
    tell: impl FnMut(Progress) -> bool,
) -> Result<Weights, Error> {
    check(settings, rollouts)?;
    let threads = settings.threads.max(1);
    let mut first = seed::rng(settings.seed, START);
    match kind {
        NetworkKind::Ordered => {
            let net = kind.heat_network();
            let mut passes: Vec<Pass> = (0..threads).map(|_| Pass::new(&net)).collect();
            descend(settings, net.initial(&mut first), tell, |streams, weights, gradient| {
                mean_gradient(streams, &mut passes, gradient, |stream, pass, gradient| {
                    let sample = Labelled::draw(rollouts, &mut seed::rng(settings.seed, *stream));
                    sample.judge(&net, weights, pass, gradient)
                })
            })
        }
        NetworkKind::Transporter => {
            let nets = Nets::new();
            let mut passes: Vec<_> = (0..threads).map(|_| nets.passes()).collect();
            let all = descend(settings, nets.initial(&mut first), tell, |streams, weights, gradient| {
                mean_gradient(streams, &mut passes, gradient, |stream, passes, gradient| {
                    let pair = Pair::draw(rollouts, &mut seed::rng(settings.seed, *stream));
                    nets.judge(&pair, weights, passes, gradient)
                })
            })?;
            // Only the heat network is needed to track.
            Ok(all[..nets.heat_weights()].to_vec())
        }
    }
}

fn check(settings: &TrainingSettings, rollouts: &[Rollout]) -> Result<(), Error> {
    let fault = |field, expected, got: String| Err(Error::Parameter { field, expected, got });
    if settings.steps == 0 || settings.batch == 0 {
        return fault(
            "steps",
            "at least one, of at least one sample",
            format!("{} of {}", settings.steps, settings.batch),
        );
    }
    if rollouts.is_empty() {
        return fault("rollouts", "at least one episode", "none".to_owned());
    }
    let is_good = |view: &ObjectView| {
        let finite = view.line.iter().flatten().all(|c| c.is_finite()) && view.half_width.is_finite();
        finite && view.line.len() > 1 && view.length() > 0.0
    };
    match rollouts.iter().position(|rollout| rollout.is_empty() || !rollout.iter().all(is_good)) {
        None => Ok(()),
        Some(k) => fault("rollouts", "views with lines of finite points", format!("others in episode {k}")),
    }
}

/// Descends along the gradients of batches. `slope` writes the gradient of the samples of some random streams, and returns their loss.
fn descend(
    settings: &TrainingSettings,
    mut weights: Weights,
    mut tell: impl FnMut(Progress) -> bool,
    mut slope: impl FnMut(&[u64], &[f32], &mut [f32]) -> f64,
) -> Result<Weights, Error> {
    let mut adam = Adam::new(weights.len());
    let mut gradient = vec![0.0; weights.len()];
    for step in 0..settings.steps {
        let streams: Vec<u64> = (0..settings.batch as u64).map(|k| (step * settings.batch) as u64 + k).collect();
        let loss = slope(&streams, &weights, &mut gradient);
        if !loss.is_finite() {
            let got = format!("{loss} in step {step}");
            return Err(Error::Parameter { field: "loss", expected: "a finite number: a lower rate may help", got });
        }
        clip(&mut gradient);
        adam.step(&mut weights, &gradient, rate(settings.rate, step, settings.steps));
        if !tell(Progress { step: step + 1, loss }) {
            return Err(Error::Interrupted);
        }
    }
    Ok(weights)
}
