//! Clipped surrogate loss and its derivatives by the networks' outputs.

use crate::settings::Settings;
use std::f32::consts::{LN_2, PI};

/// Log density of the two components of `action` under a Gaussian with mean `mean` and log standard deviation `log_std`.
pub fn log_probability(action: &[f32; 2], mean: &[f32], log_std: &[f32; 2]) -> f32 {
    (0..2)
        .map(|i| {
            let z = (action[i] - mean[i]) / log_std[i].exp();
            -0.5 * (z * z + LN_2 + PI.ln()) - log_std[i]
        })
        .sum()
}

/// Entropy in nat of a Gaussian over two components with log standard deviations `log_std`.
pub fn entropy(log_std: &[f32; 2]) -> f32 {
    log_std.iter().map(|l| l + 0.5 * (1.0 + LN_2 + PI.ln())).sum()
}

/// Inputs of the loss of one sample.
#[derive(Debug, Clone, Copy)]
pub struct Term {
    /// Sampled action.
    pub action: [f32; 2],
    /// Log density of the action when it was sampled.
    pub old_log_probability: f32,
    /// Normalised advantage.
    pub advantage: f32,
    /// Target of the value function.
    pub target: f32,
}

/// Loss of one sample and its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// Derivative by the mean.
    pub mean: [f32; 2],
    /// Derivative by the log standard deviation.
    pub log_std: [f32; 2],
    /// Derivative by the value.
    pub value: f32,
    /// Value minus its target.
    pub error: f32,
    /// Approximate Kullback-Leibler divergence from the sampling policy, `ratio - 1 - ln ratio` (Schulman 2020).
    pub kl: f32,
    /// Loss.
    pub loss: f32,
}

/// Loss `-min(r A, clip(r) A) + c_v (V - target)^2 - c_e H` of one sample and its derivatives (Schulman et al. 2017,
/// equations 7 and 9). `r` is the ratio of the new to the old probability density and `A` the advantage.
pub fn derivatives(term: &Term, mean: &[f32], log_std: &[f32; 2], value: f32, settings: &Settings) -> Derivatives {
    let log_ratio = log_probability(&term.action, mean, log_std) - term.old_log_probability;
    let ratio = log_ratio.exp();
    let clipped = ratio.clamp(1.0 - settings.clip_range, 1.0 + settings.clip_range);
    let (plain, bounded) = (ratio * term.advantage, clipped * term.advantage);
    // The surrogate does not depend on the parameters while the clip is active.
    let by_log_probability = if plain <= bounded { -ratio * term.advantage } else { 0.0 };
    let z: [f32; 2] = std::array::from_fn(|i| (term.action[i] - mean[i]) / log_std[i].exp());
    let error = value - term.target;
    Derivatives {
        mean: std::array::from_fn(|i| by_log_probability * z[i] / log_std[i].exp()),
        // The entropy of a Gaussian grows by one nat with each log standard deviation.
        log_std: std::array::from_fn(|i| by_log_probability * (z[i] * z[i] - 1.0) - settings.entropy_weight),
        value: 2.0 * settings.value_weight * error,
        error,
        kl: ratio - 1.0 - log_ratio,
        loss: -plain.min(bounded) + settings.value_weight * error * error - settings.entropy_weight * entropy(log_std),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_finite_differences() {
        let settings = Settings { entropy_weight: 0.01, ..Settings::sb3() };
        // Ratios on both sides of the clip range, for advantages of either sign.
        for (advantage, old) in [(1.3, -1.0), (-0.7, -1.0), (1.3, -3.0), (-0.7, -0.2)] {
            let term = Term { action: [0.3, -0.5], old_log_probability: old, advantage, target: 0.8 };
            let at = |m: [f32; 2], l: [f32; 2], v: f32| derivatives(&term, &m, &l, v, &settings).loss;
            let (m, l, v, h) = ([0.1, 0.2], [-0.3, 0.1], 0.5, 1e-3);
            let d = derivatives(&term, &m, &l, v, &settings);
            let close = |analytic: f32, up: f32, down: f32| {
                let numeric = (up - down) / (2.0 * h);
                assert!((numeric - analytic).abs() < 5e-3 * (1.0 + analytic.abs()), "{numeric} against {analytic}");
            };
            close(d.mean[0], at([m[0] + h, m[1]], l, v), at([m[0] - h, m[1]], l, v));
            close(d.mean[1], at([m[0], m[1] + h], l, v), at([m[0], m[1] - h], l, v));
            close(d.log_std[0], at(m, [l[0] + h, l[1]], v), at(m, [l[0] - h, l[1]], v));
            close(d.value, at(m, l, v + h), at(m, l, v - h));
        }
    }

    #[test]
    fn the_density_is_that_of_a_gaussian() {
        let expected = -0.5 * (1.0f32 + 4.0) - (2.0 * PI).ln() - 0.5f32.ln();
        let got = log_probability(&[1.0, 1.0], &[0.0, 0.0], &[0.0, 0.5f32.ln()]);
        assert!((got - expected).abs() < 1e-6, "{got} against {expected}");
    }
}
