//! Interval factors: multipliers of a posterior's standard deviations along each axis with which its central intervals hold
//! their share of held-out samples (split conformal prediction, Vovk, Gammerman and Shafer 2005).
//!
//! The inflation (see `inflation`) maximises the likelihood of the joint density. It makes the joint regions hold their share
//! and leaves the intervals of single parameters too narrow, because a mixture with wrong correlations or tails has a joint
//! and a marginal optimum. Each axis therefore gets a factor of its own from its marginal.

use super::head::Parts;
use super::truncation::Between;

/// Level of the intervals that get their share, that of the intervals in [`catenary_core::posterior::Marginal`].
const LEVEL: f64 = 0.9;
/// Step of the factor's logarithm in the search.
const STEP: f64 = 0.02;
/// Largest number of steps: factors of up to 3, with which the truncated marginal of an undetermined parameter is nearly flat.
const MOST_STEPS: i32 = 55;

/// Marginal of a held-out sample's mixture along one axis, with the sample's value.
pub(super) struct Marginal {
    /// Weights, means and standard deviations of the K components.
    components: Vec<[f64; 3]>,
    /// Unit coordinate of the sample.
    value: f64,
    /// Importance weight of the sample.
    weight: f64,
}

impl Marginal {
    /// Marginal of `parts` along `axis`, for a sample with the unit coordinate `value` and an importance weight.
    pub(super) fn new(parts: &Parts, axis: usize, value: f64, weight: f64) -> Self {
        let (weights, means, covariances) = parts;
        let component = |((w, m), c): ((&f64, &nalgebra::DVector<f64>), &nalgebra::DMatrix<f64>)| {
            [*w, m[axis], c[(axis, axis)].sqrt()]
        };
        let components = weights.iter().zip(means).zip(covariances).map(component).collect();
        Self { components, value, weight }
    }

    /// Share of the marginal, truncated to the prior's support, below the sample's value after multiplication of the standard
    /// deviations by `factor`.
    fn share_below(&self, factor: f64) -> f64 {
        let (mut below, mut inside) = (0.0, 0.0);
        for [weight, mean, sd] in &self.components {
            let z = |u: f64| (u - mean) / (factor * sd);
            below += weight * Between::new(z(0.0), z(self.value)).mass();
            inside += weight * Between::new(z(0.0), z(1.0)).mass();
        }
        // A mixture wholly outside of the support has no interval that could hold the value.
        if inside > 0.0 { below / inside } else { 0.0 }
    }

    /// Returns true if the central interval of [`LEVEL`] holds the sample's value.
    fn is_held(&self, factor: f64) -> bool {
        (self.share_below(factor) - 0.5).abs() < 0.5 * LEVEL
    }
}

/// Share of `marginals` whose central 90 % intervals hold their values after multiplication of the standard deviations by
/// `factor`, by weight.
pub(super) fn coverage(marginals: &[Marginal], factor: f64) -> f64 {
    let total: f64 = marginals.iter().map(|m| m.weight).sum();
    marginals.iter().filter(|m| m.is_held(factor)).map(|m| m.weight).sum::<f64>() / total
}

/// Least factor from 1 to 3 with which the intervals hold their share of `marginals` and one more, as the conformal quantile
/// demands: a further sample then lies in its interval with a probability of at least [`LEVEL`], if it is exchangeable with
/// them. If no factor suffices, as for fewer than nine samples, the least one with the largest share.
pub(super) fn factor(marginals: &[Marginal]) -> f64 {
    let n = marginals.len() as f64;
    let least = LEVEL * (n + 1.0) / n;
    let mut best = (f64::NEG_INFINITY, 1.0);
    for step in 0..=MOST_STEPS {
        let factor = (STEP * f64::from(step)).exp();
        let held = coverage(marginals, factor);
        if held > best.0 {
            best = (held, factor);
        }
        if held >= least {
            break;
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use nalgebra::{DMatrix, DVector};
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// Marginals of Gaussian posteriors that claim a standard deviation `said` times that of their errors, 0.02.
    fn marginals(count: u64, said: f64, stream: u64) -> Vec<Marginal> {
        let one = |i: u64| {
            let mut rng = seed::rng(stream, i);
            let value = 0.3 + 0.4 * rng.random::<f64>();
            let mean = value + 0.02 * rng.sample::<f64, _>(StandardNormal);
            let covariance = DMatrix::from_element(1, 1, (said * 0.02).powi(2));
            let parts = (vec![1.0], vec![DVector::from_element(1, mean)], vec![covariance]);
            Marginal::new(&parts, 0, value, 1.0)
        };
        (0..count).map(one).collect()
    }

    /// Six tests of 90 % at four standard errors: one wrong seed in 2,600. The factor from 300 samples adds an error, of
    /// about the size of one from 300 further samples.
    #[test]
    fn intervals_hold_their_share_of_fresh_samples() {
        for (said, stream) in [(0.6, 1), (0.8, 2), (0.95, 3)] {
            let factor = factor(&marginals(300, said, stream));
            let fresh = marginals(1_000, said, 10 + stream);
            let error = (0.09_f64 * (1.0 / 300.0 + 1.0 / 1_000.0)).sqrt();
            let held = coverage(&fresh, factor);
            assert!((held - 0.9).abs() < 4.0 * error, "said {said}: factor {factor}, {held} of fresh samples");
            assert!(coverage(&fresh, 1.0) <= held, "said {said}");
            // The exact factor is the inverse of the claim.
            assert!((factor * said - 1.0).abs() < 0.2, "said {said}: factor {factor}");
        }
    }

    #[test]
    fn nothing_is_deflated_and_intervals_hold_all_of_few_samples() {
        assert_eq!(factor(&marginals(300, 1.5, 4)), 1.0);
        // Nine tenths of eight samples and one more are more than eight.
        let few = marginals(8, 0.4, 5);
        let factor = factor(&few);
        assert!(coverage(&few, factor) == 1.0 && coverage(&few, factor / 1.03) < 1.0, "{factor}");
    }

    #[test]
    fn the_mean_is_over_weights() {
        let mut all = marginals(100, 0.7, 6);
        let outside = |m: &Marginal| !m.is_held(1.0);
        let count = all.iter().filter(|m| outside(m)).count();
        assert!(count > 5, "{count}");
        all.iter_mut().filter(|m| outside(m)).for_each(|m| m.weight = 0.0);
        assert_eq!((coverage(&all, 1.0), factor(&all)), (1.0, 1.0));
    }

    #[test]
    fn an_undetermined_parameter_gets_the_prior() {
        // Uniform values; the mixture claims to know them, always the same.
        let parts = (vec![1.0], vec![DVector::from_element(1, 0.45)], vec![DMatrix::from_element(1, 1, 0.06)]);
        let uniform: Vec<Marginal> =
            (0..500).map(|i| Marginal::new(&parts, 0, (f64::from(i) + 0.5) / 500.0, 1.0)).collect();
        // A flat marginal would hold nine tenths of the values. The conformal quantile demands slightly more, which no factor
        // gives.
        let (factor, narrow) = (factor(&uniform), coverage(&uniform, 1.0));
        let held = coverage(&uniform, factor);
        assert!(narrow < 0.87 && (held - 0.9).abs() < 0.02 && factor > 2.0, "{narrow}, {held}, {factor}");
        let far = (vec![1.0], vec![DVector::from_element(1, 99.0)], vec![DMatrix::identity(1, 1)]);
        assert!(!Marginal::new(&far, 0, 0.5, 1.0).is_held(1.0));
    }
}
