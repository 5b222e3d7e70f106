//! How much wider than the networks make them held-out tracks want their mixtures.
//!
//! Few tracks leave a network too sure of itself. And a network learns a mixture that nothing cuts off, while posteriors are
//! mixtures truncated to the prior's support: where a parameter is hardly known, the Gaussian that fits its posterior best has
//! the standard deviation of the prior, and loses a fifth of that when the prior's edges cut it off.

use super::{Activations, Network, Samples, TrainingError};
use std::ops::ControlFlow;

/// Standard deviation of the logarithm of each factor before any held-out track is seen: few tracks say little.
const PRIOR_SD: f64 = 0.15;
/// Step of these logarithms, and most steps.
const STEP: f64 = 0.04;
const MOST_STEPS: i32 = 15;
/// Most held-out tracks of a network that are looked at: they tell a factor to 3 %.
const MOST_TRACKS: usize = 500;

/// A network and the tracks that it held out.
pub(super) struct Member {
    network: Network,
    /// Its raw outputs for each track.
    raw: Vec<f32>,
    /// The same on average.
    mean: Vec<f64>,
    thetas: Vec<f64>,
    weights: Vec<f64>,
}

impl Member {
    /// `network`, which held out those of `samples` (with `weights`) that `held_out` counts. Of many, some are looked at.
    pub(super) fn new(network: Network, samples: &Samples, weights: &[f64], held_out: &[usize]) -> Self {
        let every = held_out.len().div_ceil(MOST_TRACKS).max(1);
        let held_out: Vec<usize> = held_out.iter().copied().step_by(every).collect();
        let batch = samples.gather(&held_out);
        let weights: Vec<f64> = held_out.iter().map(|&i| weights[i]).collect();
        let raw = network.forward(&network.inputs(&batch), &mut Activations::default()).to_vec();
        let mean = network.mean_outputs(&raw, &weights);
        Self { network, raw, mean, thetas: batch.thetas().to_vec(), weights }
    }

    /// What the raw outputs are multiplied by, and what is added to them, for the standard deviations of components to be `factors`
    /// (D) times as large along the axes.
    fn changes(&self, factors: &[f64]) -> Vec<(f64, f64)> {
        let shrink: Vec<f64> = factors.iter().map(|f| 1.0 / f).collect();
        self.network.shape().head.scaled(&self.mean, &shrink)
    }

    /// Held-out loss of the truncated density that has them.
    fn loss(&self, factors: &[f64]) -> f64 {
        let changes = self.changes(factors);
        let changed = self.raw.iter().zip(changes.iter().cycle()).map(|(v, (f, t))| (f64::from(*v) * f + t) as f32);
        self.network.truncated_loss(&changed.collect::<Vec<_>>(), &self.thetas, &self.weights)
    }

    /// The network that has them.
    fn widened(mut self, factors: &[f64]) -> Network {
        let changes = self.changes(factors);
        self.network.change_outputs(&changes);
        self.network
    }
}

/// The networks with the standard deviations of their components as many times as large along each of the D axes, once or up to
/// e^0.6 times, as their held-out tracks are likeliest under (Guo et al. 2017, "On calibration of modern neural networks", with factors in
/// the place of a temperature), and the mean of the held-out losses that they then have. `tick` may stop the search.
pub(super) fn widened(
    members: Vec<Member>,
    dimension: usize,
    tick: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<(Vec<Network>, f64), TrainingError> {
    let held_out: f64 = members.iter().map(|m| m.weights.len() as f64).sum();
    let logs = |steps: &[i32]| -> Vec<f64> { steps.iter().map(|s| STEP * f64::from(*s)).collect() };
    let factors = |steps: &[i32]| -> Vec<f64> { logs(steps).into_iter().map(f64::exp).collect() };
    let loss = |steps: &[i32]| members.iter().map(|m| m.loss(&factors(steps))).sum::<f64>() / members.len() as f64;
    let cost =
        |steps: &[i32]| held_out * loss(steps) + 0.5 * logs(steps).iter().map(|l| (l / PRIOR_SD).powi(2)).sum::<f64>();
    let beside = |steps: &[i32], axis: usize, by: i32| {
        let mut next = steps.to_vec();
        next[axis] += by;
        (0..=MOST_STEPS).contains(&next[axis]).then(|| (cost(&next), next))
    };
    let mut steps = vec![0; dimension];
    let mut least = cost(&steps);
    let mut moves = true;
    while std::mem::take(&mut moves) {
        for (axis, by) in (0..dimension).flat_map(|axis| [4, 1, -1].map(|by| (axis, by))) {
            loop {
                if tick().is_break() {
                    return Err(TrainingError::Stopped);
                }
                let Some(better) = beside(&steps, axis, by).filter(|(found, _)| *found < least) else { break };
                (least, steps) = better;
                moves = true;
            }
        }
    }
    let (factors, loss, is_as_it_was) = (factors(&steps), loss(&steps), steps.iter().all(|s| *s == 0));
    let widen = |m: Member| if is_as_it_was { m.network } else { m.widened(&factors) };
    Ok((members.into_iter().map(widen).collect(), loss))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Shape;
    use crate::settings::Settings;
    use catenary_core::seed;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// Factors of the standard deviations that held-out tracks of `thetas` want, of a network that says, whatever it sees, that
    /// theta has one normal distribution: that of `thetas`, but for standard deviations `said` times as large.
    fn wanted(said: [f64; 2], thetas: &[[f64; 2]]) -> Vec<f64> {
        let rows = (0..thetas.len()).map(|i| (i as f32).sin()).collect();
        let samples = Samples::of_rows(rows, 1, thetas.concat(), 2);
        let shape = Shape::of_samples(&samples, &Settings { components: 1, ..Settings::default() });
        let weights = vec![1.0; thetas.len()];
        let mut network = Network::new(shape, 1.0, &samples, &weights, &mut seed::rng(46, 0));
        // Whitened coordinates are those in which `thetas` have the mean zero and the standard deviation one.
        let outputs = network.shape().head.outputs();
        let biases = network.parameters().len() - network.shape().skip_count() - outputs;
        let [_, diagonals, _] = network.shape().head.offsets();
        network.parameters_mut().fill(0.0);
        for (axis, factor) in said.into_iter().enumerate() {
            network.parameters_mut()[biases + diagonals + axis] = -factor.ln() as f32;
        }
        let covariance = |n: &Network| n.mixture_parts(&samples.gather(&[0])).2.remove(0);
        let before = covariance(&network);
        let held_out: Vec<usize> = (0..thetas.len()).collect();
        let members = vec![Member::new(network, &samples, &weights, &held_out)];
        let (after, loss) = widened(members, 2, &mut || ControlFlow::Continue(())).unwrap();
        assert!(loss.is_finite());
        let after = covariance(&after[0]);
        (0..2).map(|axis| (after[(axis, axis)] / before[(axis, axis)]).sqrt()).collect()
    }

    /// The first coordinate normal about the middle or uniform, the second normal.
    fn thetas(count: usize, uniform: bool) -> Vec<[f64; 2]> {
        let mut rng = seed::rng(47, 0);
        let mut normal = || 0.5 + 0.08 * rng.sample::<f64, _>(StandardNormal);
        let second: Vec<f64> = (0..count).map(|_| normal()).collect();
        let first = |i: usize| (i as f64 + 0.5) / count as f64;
        second.iter().enumerate().map(|(i, v)| [if uniform { first(i) } else { normal() }, *v]).collect()
    }

    #[test]
    fn networks_too_sure_of_an_axis_are_widened_along_it_by_as_much() {
        let factors = wanted([1.0 / 1.5, 1.0], &thetas(400, false));
        // A step is 4 %; the distribution that goes before draws the logarithm, 0.4, by 1 / (2 * 400 * 0.15^2) of itself, 6 %.
        assert!((1.4..1.56).contains(&factors[0]) && factors[1] < 1.05, "{factors:?}");
    }

    #[test]
    fn few_tracks_say_little_and_networks_are_never_made_surer() {
        let few = wanted([1.0 / 1.5, 1.0], &thetas(10, false));
        assert!((1.0..1.35).contains(&few[0]), "{few:?}");
        let unsure = wanted([1.5, 1.2], &thetas(400, false));
        assert!(unsure.iter().all(|f| (f - 1.0).abs() < 1e-6), "{unsure:?}");
    }

    #[test]
    fn what_is_uniform_between_the_priors_edges_is_widened_beyond_them() {
        // The standard deviation of a normal distribution of 1.5 / sqrt(12) about the middle, cut off at the edges, is within
        // 8 % of the uniform one's; of 1 / sqrt(12) it is 21 % less.
        let factors = wanted([1.0, 1.0], &thetas(400, true));
        assert!(factors[0] > 1.5 && factors[1] < 1.05, "{factors:?}");
    }
}
