//! Covariance inflation that maximises the held-out likelihood.
//!
//! Two effects make the networks' mixtures too narrow. A network trained on few tracks is overconfident. A network also
//! learns an untruncated mixture, while the posterior is truncated to the prior's support: the Gaussian that fits the
//! posterior of an undetermined parameter has the standard deviation of the prior, and truncation removes a fifth of it.

use super::{Activations, Network, Samples, TrainingError};
use std::ops::ControlFlow;

/// Prior standard deviation of the logarithm of each factor: few held-out tracks change it little.
const PRIOR_SD: f64 = 0.15;
/// Step of these logarithms in the search.
const STEP: f64 = 0.04;
/// Largest number of steps: factors of up to e^0.6 = 1.8.
const MOST_STEPS: i32 = 15;
/// Largest number of held-out tracks of a network in the search. They determine a factor to 3 %.
const MOST_TRACKS: usize = 500;

/// Network with its held-out tracks.
pub(super) struct Member {
    network: Network,
    /// Raw outputs of the head for each track.
    raw: Vec<f32>,
    /// Weighted mean of the raw outputs.
    mean: Vec<f64>,
    thetas: Vec<f64>,
    weights: Vec<f64>,
}

impl Member {
    /// Pairs `network` with the samples at `held_out`, thinned to [`MOST_TRACKS`].
    pub(super) fn new(network: Network, samples: &Samples, weights: &[f64], held_out: &[usize]) -> Self {
        let every = held_out.len().div_ceil(MOST_TRACKS).max(1);
        let held_out: Vec<usize> = held_out.iter().copied().step_by(every).collect();
        let batch = samples.gather(&held_out);
        let weights: Vec<f64> = held_out.iter().map(|&i| weights[i]).collect();
        let raw = network.forward(&network.inputs(&batch), &mut Activations::default()).to_vec();
        let mean = network.mean_outputs(&raw, &weights);
        Self { network, raw, mean, thetas: batch.thetas().to_vec(), weights }
    }

    /// Factor and term for each raw output that multiply the standard deviations of the components by `factors` (D) along the
    /// axes.
    fn changes(&self, factors: &[f64]) -> Vec<(f64, f64)> {
        let shrink: Vec<f64> = factors.iter().map(|f| 1.0 / f).collect();
        self.network.shape().head.scaled(&self.mean, &shrink)
    }

    /// Held-out loss of the truncated density after inflation by `factors`.
    fn loss(&self, factors: &[f64]) -> f64 {
        let changes = self.changes(factors);
        let changed = self.raw.iter().zip(changes.iter().cycle()).map(|(v, (f, t))| (f64::from(*v) * f + t) as f32);
        self.network.truncated_loss(&changed.collect::<Vec<_>>(), &self.thetas, &self.weights)
    }

    /// Network after inflation by `factors`.
    fn inflated(mut self, factors: &[f64]) -> Network {
        let changes = self.changes(factors);
        self.network.change_outputs(&changes);
        self.network
    }
}

/// Inflates the standard deviations of all networks' components along each of the D axes by the factors, from 1 to e^0.6,
/// that maximise the held-out likelihood times the prior of the factors. It is temperature scaling (Guo et al. 2017, "On calibration
/// of modern neural networks") with a factor for each axis. Returns the networks and the mean of their held-out losses. `tick`
/// may stop the search.
///
/// # Errors
/// [`TrainingError::Stopped`] if `tick` breaks.
pub(super) fn inflated(
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
        // Coordinate search. Long steps first save evaluations, each of which visits all held-out tracks.
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
    // Factors of one would still round the parameters.
    let inflate = |m: Member| if is_as_it_was { m.network } else { m.inflated(&factors) };
    Ok((members.into_iter().map(inflate).collect(), loss))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Shape;
    use crate::settings::Settings;
    use catenary_core::seed;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// Inflation factors for held-out tracks of `thetas` and a network whose output is always the normal distribution of
    /// `thetas`, with standard deviations `said` times as large.
    fn factors_for(said: [f64; 2], thetas: &[[f64; 2]]) -> Vec<f64> {
        let rows = (0..thetas.len()).map(|i| (i as f32).sin()).collect();
        let samples = Samples::of_rows(rows, 1, thetas.concat(), 2);
        let shape = Shape::of_samples(&samples, &Settings { components: 1, ..Settings::default() });
        let weights = vec![1.0; thetas.len()];
        let mut network = Network::new(shape, 1.0, &samples, &weights, &mut seed::rng(46, 0));
        // In whitened coordinates `thetas` have mean zero and standard deviation one.
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
        let (after, loss) = inflated(members, 2, &mut || ControlFlow::Continue(())).unwrap();
        assert!(loss.is_finite());
        let after = covariance(&after[0]);
        (0..2).map(|axis| (after[(axis, axis)] / before[(axis, axis)]).sqrt()).collect()
    }

    /// Thetas whose first coordinate is uniform or normal about the middle, and whose second one is normal.
    fn thetas(count: usize, uniform: bool) -> Vec<[f64; 2]> {
        let mut rng = seed::rng(47, 0);
        let mut normal = || 0.5 + 0.08 * rng.sample::<f64, _>(StandardNormal);
        let second: Vec<f64> = (0..count).map(|_| normal()).collect();
        let first = |i: usize| (i as f64 + 0.5) / count as f64;
        second.iter().enumerate().map(|(i, v)| [if uniform { first(i) } else { normal() }, *v]).collect()
    }

    #[test]
    fn networks_too_narrow_along_an_axis_are_inflated_along_it() {
        let factors = factors_for([1.0 / 1.5, 1.0], &thetas(400, false));
        // A step is 4 %. The prior shrinks the logarithm, 0.4, by 1 / (2 * 400 * 0.15^2) of itself, 6 %.
        assert!((1.4..1.56).contains(&factors[0]) && factors[1] < 1.05, "{factors:?}");
    }

    #[test]
    fn few_tracks_inflate_little_and_nothing_is_deflated() {
        let few = factors_for([1.0 / 1.5, 1.0], &thetas(10, false));
        assert!((1.0..1.35).contains(&few[0]), "{few:?}");
        let unsure = factors_for([1.5, 1.2], &thetas(400, false));
        assert!(unsure.iter().all(|f| (f - 1.0).abs() < 1e-6), "{unsure:?}");
    }

    #[test]
    fn a_parameter_uniform_between_the_priors_edges_is_inflated_beyond_them() {
        // Truncated to the edges, a normal distribution of standard deviation 1.5 / sqrt(12) has that of the uniform one to
        // 8 %; one of 1 / sqrt(12) is 21 % narrower.
        let factors = factors_for([1.0, 1.0], &thetas(400, true));
        assert!(factors[0] > 1.5 && factors[1] < 1.05, "{factors:?}");
    }
}
