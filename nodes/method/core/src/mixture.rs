//! Mixtures of Gaussians with full covariances.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Most components, and most coordinates, of a mixture in a file. They bound the memory and the time that a damaged file can claim.
const MOST_COMPONENTS: usize = 10_000;
const MOST_COORDINATES: usize = 256;
/// Greatest distance of a mean from 0, and greatest standard deviation, in a file, in unit coordinates. Far beyond those of a badly trained
/// network (1e13): their products stay finite.
const GREATEST: f64 = 1e30;
/// Number of rejected draws after which the mixture counts as lying outside the unit cube.
const MAX_REJECTIONS: usize = 100_000;

/// Mixture of K Gaussians over D coordinates.
///
/// The coordinates are the unit coordinates of [`crate::ParameterSpace`]. A posterior is the mixture truncated to the
/// unit cube.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Mixture {
    weights: Vec<f64>,
    components: Vec<Component>,
}

/// Gaussian with its Cholesky factor.
#[derive(Debug, Clone)]
struct Component {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    cholesky: Cholesky<f64, Dyn>,
    /// Logarithm of the normalising factor, `-(D ln 2 pi + ln det covariance) / 2`.
    log_norm: f64,
}

impl PartialEq for Component {
    fn eq(&self, other: &Self) -> bool {
        self.mean == other.mean && self.covariance == other.covariance
    }
}

/// File format of a mixture.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    weights: Vec<f64>,
    means: Vec<Vec<f64>>,
    covariances: Vec<Vec<Vec<f64>>>,
}

/// Reason for which a mixture is refused.
#[derive(Debug, Error, PartialEq)]
pub enum MixtureError {
    /// Numbers of weights, means and covariances that differ, or sizes that do not fit.
    #[error("mixture: expected {expected}, got {got}")]
    Shape {
        /// Expected shape.
        expected: String,
        /// Given shape.
        got: String,
    },
    /// Weights that are negative, not finite, or sum to zero.
    #[error("mixture: weights must be finite, not negative, and not all zero, got {0:?}")]
    Weights(Vec<f64>),
    /// Component whose covariance is not symmetric positive definite, or whose mean is not finite.
    #[error("mixture: component {0}: expected a finite mean and a symmetric positive definite covariance")]
    Component(usize),
    /// Component of a file that is too far from the support, or too wide, to be a posterior.
    #[error(
        "mixture: component {component}: expected means within 1e30 and variances of at most 1e60, in unit coordinates, got {got:e}"
    )]
    Size {
        /// Index of the component.
        component: usize,
        /// Value out of range.
        got: f64,
    },
    /// Mixture with (nearly) no mass in the unit cube.
    #[error("mixture: no draw fell inside the support of the prior")]
    OutsideSupport,
}

impl Mixture {
    /// Builds a mixture from K weights, K means of length D and K covariances of D x D. Normalises the weights.
    ///
    /// # Errors
    /// [`MixtureError`] if shapes do not fit, weights are negative or all zero, or a covariance is not positive
    /// definite.
    pub fn new(
        weights: &[f64],
        means: Vec<DVector<f64>>,
        covariances: Vec<DMatrix<f64>>,
    ) -> Result<Self, MixtureError> {
        let k = weights.len();
        if k == 0 || means.len() != k || covariances.len() != k {
            return Err(MixtureError::Shape {
                expected: "as many means and covariances as weights, at least one".into(),
                got: format!("{k} weights, {} means, {} covariances", means.len(), covariances.len()),
            });
        }
        let total: f64 = weights.iter().sum();
        // Weights whose sum is within 1e-12 of 1 are not divided, so that a mixture read from a file has the same bits.
        let total = if (total - 1.0).abs() < 1e-12 { 1.0 } else { total };
        if !(total.is_finite() && total > 0.0 && weights.iter().all(|w| *w >= 0.0)) {
            return Err(MixtureError::Weights(weights.to_vec()));
        }
        let d = means[0].len();
        let mut components = Vec::with_capacity(k);
        for (i, (mean, covariance)) in means.into_iter().zip(covariances).enumerate() {
            if mean.len() != d || covariance.shape() != (d, d) {
                return Err(MixtureError::Shape {
                    expected: format!("a mean of {d} and a covariance of {d} x {d}"),
                    got: format!("{} and {:?}", mean.len(), covariance.shape()),
                });
            }
            components.push(Component::new(mean, covariance).ok_or(MixtureError::Component(i))?);
        }
        Ok(Self { weights: weights.iter().map(|w| w / total).collect(), components })
    }

    /// Number D of coordinates.
    pub fn dimension(&self) -> usize {
        self.components[0].mean.len()
    }

    /// K weights, which sum to 1.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Mean (D) and covariance (D x D) of component `k`.
    pub fn component(&self, k: usize) -> (&DVector<f64>, &DMatrix<f64>) {
        (&self.components[k].mean, &self.components[k].covariance)
    }

    /// Log density of the untruncated mixture at `u` (length D).
    pub fn log_density(&self, u: &[f64]) -> f64 {
        let terms: Vec<f64> = self
            .weights
            .iter()
            .zip(&self.components)
            // The logarithm of a zero weight is minus infinity.
            .filter(|(w, _)| **w > 0.0)
            .map(|(w, c)| w.ln() + c.log_density(u))
            .collect();
        log_sum_exp(&terms)
    }

    /// Draws one point (length D) from the untruncated mixture.
    pub fn sample<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        let k = self.pick(rng.random::<f64>());
        self.components[k].sample(rng)
    }

    /// Draws one point (length D) from the mixture truncated to the unit cube, by rejection.
    ///
    /// # Errors
    /// [`MixtureError::OutsideSupport`] if no draw falls inside.
    pub fn sample_truncated<R: Rng>(&self, rng: &mut R) -> Result<Vec<f64>, MixtureError> {
        (0..MAX_REJECTIONS).map(|_| self.sample(rng)).find(|u| in_unit_cube(u)).ok_or(MixtureError::OutsideSupport)
    }

    /// Draws `n` points from the truncated mixture with low variance over the components.
    ///
    /// Systematic sampling picks the components (Thrun, Burgard and Fox 2005, table 4.4), so a component of weight over
    /// 1/n always contributes. Each picked component draws inside the unit cube. The weights are those of the truncated
    /// mixture: the weight of a component times its mass inside the cube.
    ///
    /// # Errors
    /// [`MixtureError::OutsideSupport`] if no draw falls inside.
    pub fn sample_low_variance<R: Rng>(&self, n: usize, rng: &mut R) -> Result<Vec<Vec<f64>>, MixtureError> {
        // 2000 draws estimate a mass inside the cube to 1 % (one standard error at a mass of one half).
        const MASS_DRAWS: usize = 2_000;
        let inside: Vec<f64> = self
            .components
            .iter()
            .map(|c| (0..MASS_DRAWS).filter(|_| in_unit_cube(&c.sample(rng))).count() as f64)
            .collect();
        let mut weights: Vec<f64> = self.weights.iter().zip(&inside).map(|(w, m)| w * m).collect();
        let total: f64 = weights.iter().sum();
        if total <= 0.0 {
            return Err(MixtureError::OutsideSupport);
        }
        weights.iter_mut().for_each(|w| *w /= total);
        let offset: f64 = rng.random::<f64>();
        (0..n)
            .map(|i| {
                let component = &self.components[pick(&weights, (i as f64 + offset) / n as f64)];
                (0..MAX_REJECTIONS)
                    .map(|_| component.sample(rng))
                    .find(|u| in_unit_cube(u))
                    .ok_or(MixtureError::OutsideSupport)
            })
            .collect()
    }

    /// Estimates the mass of the untruncated mixture outside the unit cube from `draws` draws.
    pub fn mass_outside<R: Rng>(&self, draws: usize, rng: &mut R) -> f64 {
        (0..draws).filter(|_| !in_unit_cube(&self.sample(rng))).count() as f64 / draws as f64
    }

    fn pick(&self, quantile: f64) -> usize {
        pick(&self.weights, quantile)
    }
}

/// Index of the weight whose interval of the cumulative weights, which sum to 1, contains `quantile`. A weight of zero is never picked.
pub fn pick(weights: &[f64], quantile: f64) -> usize {
    let mut cumulative = 0.0;
    for (k, w) in weights.iter().enumerate() {
        cumulative += w;
        if quantile < cumulative {
            return k;
        }
    }
    // The weights sum to 1 up to rounding: a quantile beyond the sum belongs to the last component with a weight.
    weights.iter().rposition(|w| *w > 0.0).unwrap_or(0)
}

/// True if every coordinate lies in [0, 1].
pub fn in_unit_cube(u: &[f64]) -> bool {
    u.iter().all(|v| (0.0..=1.0).contains(v))
}

/// Computes `ln(sum(exp(terms)))` without overflow. It is minus infinity for no terms.
pub fn log_sum_exp(terms: &[f64]) -> f64 {
    let greatest = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if greatest == f64::NEG_INFINITY {
        return greatest;
    }
    greatest + terms.iter().map(|t| (t - greatest).exp()).sum::<f64>().ln()
}

impl Component {
    fn new(mean: DVector<f64>, covariance: DMatrix<f64>) -> Option<Self> {
        let finite = mean.iter().chain(covariance.iter()).all(|v| v.is_finite());
        let scale = covariance.amax();
        // A product of matrices is symmetric up to rounding.
        let symmetric = (&covariance - covariance.transpose()).amax() <= 1e-9 * scale;
        if !finite || !symmetric {
            return None;
        }
        let cholesky = Cholesky::new(covariance.clone())?;
        let log_det: f64 = cholesky.l_dirty().diagonal().iter().map(|v| 2.0 * v.ln()).sum();
        let log_norm = -0.5 * (mean.len() as f64 * (2.0 * std::f64::consts::PI).ln() + log_det);
        Some(Self { mean, covariance, cholesky, log_norm })
    }

    fn log_density(&self, u: &[f64]) -> f64 {
        let mut whitened = DVector::from_column_slice(u) - &self.mean;
        self.cholesky.l_dirty().solve_lower_triangular_mut(&mut whitened);
        self.log_norm - 0.5 * whitened.norm_squared()
    }

    fn sample<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        let z = DVector::from_fn(self.mean.len(), |_, _| rng.sample::<f64, _>(StandardNormal));
        (&self.mean + self.cholesky.l() * z).as_slice().to_vec()
    }
}

impl TryFrom<Written> for Mixture {
    type Error = MixtureError;

    fn try_from(w: Written) -> Result<Self, MixtureError> {
        let d = w.means.first().map_or(0, Vec::len);
        let (k, components) = (w.weights.len(), w.means.len().max(w.covariances.len()));
        if k.max(components) > MOST_COMPONENTS || d > MOST_COORDINATES {
            return Err(MixtureError::Shape {
                expected: format!("at most {MOST_COMPONENTS} components of at most {MOST_COORDINATES} coordinates"),
                got: format!("{} of {d}", k.max(components)),
            });
        }
        let ragged = w.covariances.iter().any(|c| c.len() != d || c.iter().any(|row| row.len() != d));
        if ragged {
            return Err(MixtureError::Shape {
                expected: format!("covariances of {d} x {d}"),
                got: "other sizes".into(),
            });
        }
        for (i, (mean, covariance)) in w.means.iter().zip(&w.covariances).enumerate() {
            let far = |v: &&f64| v.abs() > GREATEST;
            let wide = |v: &&f64| v.abs() > GREATEST * GREATEST;
            if let Some(&got) = mean.iter().find(far).or_else(|| covariance.iter().flatten().find(wide)) {
                return Err(MixtureError::Size { component: i, got });
            }
        }
        let covariances =
            w.covariances.iter().map(|c| DMatrix::from_row_iterator(d, d, c.iter().flatten().copied())).collect();
        Mixture::new(&w.weights, w.means.into_iter().map(DVector::from_vec).collect(), covariances)
    }
}

impl From<Mixture> for Written {
    fn from(m: Mixture) -> Self {
        let rows = |c: &DMatrix<f64>| c.row_iter().map(|r| r.iter().copied().collect()).collect();
        Self {
            means: m.components.iter().map(|c| c.mean.as_slice().to_vec()).collect(),
            covariances: m.components.iter().map(|c| rows(&c.covariance)).collect(),
            weights: m.weights,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed;

    fn two() -> Mixture {
        let c = |a, b, d| DMatrix::from_row_slice(2, 2, &[a, b, b, d]);
        Mixture::new(
            &[3.0, 1.0],
            vec![DVector::from_vec(vec![0.3, 0.4]), DVector::from_vec(vec![0.8, 0.7])],
            vec![c(0.01, 0.006, 0.02), c(0.005, 0.0, 0.005)],
        )
        .unwrap()
    }

    #[test]
    fn density_integrates_to_one() {
        let m = two();
        // A grid of 400 x 400 over -1 .. 2 holds all mass of both components.
        let n = 400;
        let h = 3.0 / n as f64;
        let grid = |i: usize| -1.0 + (i as f64 + 0.5) * h;
        let sum: f64 = (0..n * n).map(|i| m.log_density(&[grid(i / n), grid(i % n)]).exp() * h * h).sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
    }

    #[test]
    fn sample_moments_match() {
        let m = two();
        let mut rng = seed::rng(1, 0);
        let draws: Vec<Vec<f64>> = (0..20_000).map(|_| m.sample(&mut rng)).collect();
        let mean = draws.iter().map(|u| u[0]).sum::<f64>() / draws.len() as f64;
        assert!((mean - (0.75 * 0.3 + 0.25 * 0.8)).abs() < 0.006, "{mean}");
    }

    #[test]
    fn every_component_above_one_nth_contributes_to_a_low_variance_sample() {
        let means = [0.1, 0.35, 0.6, 0.9].map(|v| DVector::from_vec(vec![v]));
        let m =
            Mixture::new(&[0.1, 0.2, 0.6, 0.1], means.to_vec(), vec![DMatrix::from_element(1, 1, 1e-6); 4]).unwrap();
        for s in 0..50 {
            let draws = m.sample_low_variance(12, &mut seed::rng(s, 0)).unwrap();
            for mean in [0.1, 0.35, 0.6, 0.9] {
                assert!(draws.iter().any(|u| (u[0] - mean).abs() < 0.05), "seed {s} misses {mean}");
            }
        }
    }

    #[test]
    fn truncated_draws_lie_inside_and_a_mixture_outside_the_cube_is_an_error() {
        let edge =
            Mixture::new(&[1.0], vec![DVector::from_vec(vec![1.05])], vec![DMatrix::from_element(1, 1, 0.01)]).unwrap();
        let mut rng = seed::rng(2, 0);
        assert!((0..1000).all(|_| in_unit_cube(&edge.sample_truncated(&mut rng).unwrap())));
        let outside = edge.mass_outside(20_000, &mut rng);
        assert!((outside - 0.6915).abs() < 0.02, "{outside}");
        let far =
            Mixture::new(&[1.0], vec![DVector::from_vec(vec![9.0])], vec![DMatrix::from_element(1, 1, 1e-4)]).unwrap();
        assert_eq!(far.sample_truncated(&mut rng), Err(MixtureError::OutsideSupport));
    }

    #[test]
    fn refuses_what_is_no_mixture() {
        let mean = || vec![DVector::from_vec(vec![0.0, 0.0])];
        let indefinite = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]);
        assert_eq!(Mixture::new(&[1.0], mean(), vec![indefinite]), Err(MixtureError::Component(0)));
        assert!(matches!(Mixture::new(&[-1.0], mean(), vec![DMatrix::identity(2, 2)]), Err(MixtureError::Weights(_))));
    }

    #[test]
    fn json_round_trip_keeps_the_mixture() {
        let m = two();
        let text = serde_json::to_string(&m).unwrap();
        assert_eq!(serde_json::from_str::<Mixture>(&text).unwrap(), m);
    }
}
