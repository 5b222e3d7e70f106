//! Training of the networks on simulated views.

use super::network::{NetworkKind, Weights};
use super::ordered::Labelled;
use super::transporter::{Nets, Pair};
use super::view::{ObjectView, Rollout};
use crate::Error;
use catenary_core::seed;
use convnet::{Descent, Pass, Progress, TrainingSettings, descend, mean_gradient};

/// Stream of random numbers of the first weights.
const START: u64 = u64::MAX;

/// Trains a network on views of simulated objects, or goes on with an interrupted training of the same settings and views. `tell` is called after each step, and ends the training with an error if it returns
/// false.
///
/// # Errors
/// [`Error::Training`]; [`Error::Parameter`] without steps or views, or for a view that is no line.
pub fn train(
    kind: NetworkKind,
    settings: &TrainingSettings,
    rollouts: &[Rollout],
    begun: Option<Descent>,
    tell: impl FnMut(Progress) -> bool,
) -> Result<Weights, Error> {
    check(settings, rollouts)?;
    let threads = settings.threads.max(1);
    let mut first = seed::rng(settings.seed, START);
    let start = |initial: Vec<f32>| {
        let weights = initial.len();
        match begun {
            None => Ok(Descent::new(initial)),
            Some(begun) if begun.is_of(weights) => Ok(begun),
            Some(begun) => Err(Error::Parameter {
                field: "begun",
                expected: "the state of a training of this network",
                got: format!("{} weights, not {weights}", begun.weights().len()),
            }),
        }
    };
    match kind {
        NetworkKind::Ordered => {
            let net = kind.heat_network();
            let mut passes: Vec<Pass> = (0..threads).map(|_| Pass::new(&net)).collect();
            let trained = descend(settings, start(net.initial(&mut first))?, tell, |streams, weights, gradient| {
                mean_gradient(streams, &mut passes, gradient, |stream, pass, gradient| {
                    let sample = Labelled::draw(rollouts, &mut seed::rng(settings.seed, *stream));
                    sample.judge(&net, weights, pass, gradient)
                })
            })?;
            Ok(trained)
        }
        NetworkKind::Transporter => {
            let nets = Nets::new();
            let mut passes: Vec<_> = (0..threads).map(|_| nets.passes()).collect();
            let all = descend(settings, start(nets.initial(&mut first))?, tell, |streams, weights, gradient| {
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
