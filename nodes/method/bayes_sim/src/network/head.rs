//! Mixture density head: raw outputs of the last layer to a mixture of K Gaussians over D coordinates.
//!
//! The raw outputs of one track are, in order: K logits of the weights; K x D means; K x D logarithms of the diagonals and
//! K x D(D-1)/2 entries below the diagonals (row by row) of lower triangular factors A. Component k has the precision
//! matrix `A^T A`, which is positive definite for all outputs. The logarithms of the diagonals are bent to
//! +-[`DIAGONAL_LIMIT`] by `L tanh(raw / L)`, which bounds the precisions and keeps their gradient.
//! All coordinates are whitened, `v = (u - centre) / scale`.

use super::truncation::{Lattice, Support};
use catenary_core::Mixture;
use catenary_core::mixture::{MixtureError, log_sum_exp};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Bound of the logarithm of a diagonal element of A: standard deviations are at least e^-7 of the whitened unit.
pub const DIAGONAL_LIMIT: f64 = 7.0;

/// Least variance of a component in any direction, as a share of its largest entry. Without it, rounding makes covariances
/// indefinite that a network returns far from its training data.
const LEAST_VARIANCE: f64 = 1e-12;

/// Share of the bound up to which [`unbend`] inverts the bend. Beyond it the inverse is too steep.
const MOST_BENT: f64 = 0.95;

/// Logarithm of the weight below which a component counts as lying wholly inside the support: e^-8 is 0.03 %.
const LEAST_LOG_WEIGHT: f64 = -8.0;

/// Logarithm of 2 pi.
const LN_TAU: f64 = 1.837_877_066_409_345_3;

/// Shape of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MixtureHead {
    /// K, number of components.
    pub components: usize,
    /// D, number of coordinates.
    pub dimension: usize,
}

/// Weights, means and covariances of a mixture's components.
pub type Parts = (Vec<f64>, Vec<DVector<f64>>, Vec<DMatrix<f64>>);

/// One component at a point.
struct Component {
    /// Difference from the mean, `v - mean`.
    difference: Vec<f64>,
    /// Factor A of the precision, D x D, row-major.
    factor: Vec<f64>,
    /// Whitened difference, `A (v - mean)`.
    whitened: Vec<f64>,
    log_density: f64,
}

impl MixtureHead {
    /// Number of entries below the diagonal of one factor.
    fn below(&self) -> usize {
        self.dimension * (self.dimension - 1) / 2
    }

    /// Number of raw outputs.
    pub fn outputs(&self) -> usize {
        self.components * (1 + 2 * self.dimension + self.below())
    }

    /// Indices of the first raw output of the means, of the diagonals and of the entries below the diagonals.
    pub fn offsets(&self) -> [usize; 3] {
        let (k, d) = (self.components, self.dimension);
        [k, k + k * d, k + 2 * k * d]
    }

    /// Log weights (K) from their logits.
    fn log_weights(&self, raw: &[f32]) -> Vec<f64> {
        let logits: Vec<f64> = raw[..self.components].iter().map(|&l| f64::from(l)).collect();
        let total = log_sum_exp(&logits);
        logits.iter().map(|l| l - total).collect()
    }

    /// Factor and term for each raw output that multiply column i of each A by `scale[i]` (D). The bend of the diagonals is
    /// linearised about `mean`, the mean raw outputs.
    pub(super) fn scaled(&self, mean: &[f64], scale: &[f64]) -> Vec<(f64, f64)> {
        let mut changes = vec![(1.0, 0.0); self.outputs()];
        let [_, diagonals, mut below] = self.offsets();
        for k in 0..self.components {
            for i in 0..self.dimension {
                let at = diagonals + k * self.dimension + i;
                let to = unbend(bend(mean[at]) + scale[i].ln());
                let factor = bend_slope(mean[at]) / bend_slope(to);
                changes[at] = (factor, to - factor * mean[at]);
                for by in &scale[..i] {
                    changes[below] = (*by, 0.0);
                    below += 1;
                }
            }
        }
        changes
    }

    /// Factor A of component `k`, row-major.
    fn factor(&self, raw: &[f32], k: usize) -> Vec<f64> {
        let d = self.dimension;
        let [_, diagonals, belows] = self.offsets();
        let mut factor = vec![0.0; d * d];
        let mut below = raw[belows + k * self.below()..].iter();
        for i in 0..d {
            for j in 0..i {
                factor[i * d + j] = below.next().map_or(0.0, |&v| f64::from(v));
            }
            factor[i * d + i] = bend(f64::from(raw[diagonals + k * d + i])).exp();
        }
        factor
    }

    /// Component `k` at `v`.
    fn component(&self, raw: &[f32], k: usize, v: &[f64]) -> Component {
        let d = self.dimension;
        let means = self.offsets()[0] + k * d;
        let difference: Vec<f64> = v.iter().zip(&raw[means..means + d]).map(|(v, m)| v - f64::from(*m)).collect();
        let factor = self.factor(raw, k);
        let whitened: Vec<f64> =
            factor.chunks_exact(d).map(|row| row.iter().zip(&difference).map(|(a, b)| a * b).sum()).collect();
        let log_det: f64 = (0..d).map(|i| factor[i * d + i].ln()).sum();
        let square: f64 = whitened.iter().map(|z| z * z).sum();
        Component { difference, factor, whitened, log_density: log_det - 0.5 * (square + d as f64 * LN_TAU) }
    }

    /// Negative log density at `v` of the mixture with the raw outputs `raw`. Writes `weight` times its derivatives with
    /// respect to the raw outputs to `gradient` if that is given.
    pub fn loss(&self, raw: &[f32], v: &[f64], weight: f64, gradient: Option<&mut [f32]>) -> f64 {
        let log_weights = self.log_weights(raw);
        let components: Vec<Component> = (0..self.components).map(|k| self.component(raw, k, v)).collect();
        let terms: Vec<f64> = log_weights.iter().zip(&components).map(|(w, c)| w + c.log_density).collect();
        let total = log_sum_exp(&terms);
        let Some(gradient) = gradient else { return -total };
        let d = self.dimension;
        let [means, diagonals, belows] = self.offsets();
        for (k, c) in components.iter().enumerate() {
            // Posterior probability of the component given v (Bishop 1994).
            let responsibility = (terms[k] - total).exp();
            gradient[k] = (weight * (log_weights[k].exp() - responsibility)) as f32;
            let scale = weight * responsibility;
            let mut below = belows + k * self.below();
            for i in 0..d {
                let by_mean: f64 = (i..d).map(|row| c.factor[row * d + i] * c.whitened[row]).sum();
                gradient[means + k * d + i] = (-scale * by_mean) as f32;
                let by_log = 1.0 - c.whitened[i] * c.factor[i * d + i] * c.difference[i];
                gradient[diagonals + k * d + i] =
                    (-scale * by_log * bend_slope(f64::from(raw[diagonals + k * d + i]))) as f32;
                for j in 0..i {
                    gradient[below] = (scale * c.whitened[i] * c.difference[j]) as f32;
                    below += 1;
                }
            }
        }
        -total
    }

    /// Weights, means and covariances of the mixture over `u = centre + scale * v`.
    pub fn parts(&self, raw: &[f32], centre: &[f64], scale: &[f64]) -> Parts {
        let d = self.dimension;
        let weights = self.log_weights(raw).iter().map(|w| w.exp()).collect();
        let mut means = Vec::with_capacity(self.components);
        let mut covariances = Vec::with_capacity(self.components);
        for k in 0..self.components {
            let first = self.offsets()[0] + k * d;
            means.push(DVector::from_fn(d, |i, _| centre[i] + scale[i] * f64::from(raw[first + i])));
            let root = inverse(&self.factor(raw, k), d);
            let root = DMatrix::from_fn(d, d, |i, j| scale[i] * root[i * d + j]);
            let covariance = &root * root.transpose();
            let floor = LEAST_VARIANCE * covariance.amax();
            covariances.push(covariance + DMatrix::identity(d, d) * floor);
        }
        (weights, means, covariances)
    }

    /// Logarithm of the mass of the mixture inside of `support`, with `lattice` for components that several axes cut. Each
    /// component counts with at least [`super::truncation::LEAST_INSIDE`]; a component of negligible weight counts as whole.
    pub fn log_mass(&self, raw: &[f32], support: &Support, lattice: &Lattice) -> f64 {
        let d = self.dimension;
        let inside = |(k, weight): (usize, f64)| {
            if weight < LEAST_LOG_WEIGHT {
                return weight;
            }
            let means = self.offsets()[0] + k * d;
            let mean: Vec<f64> = raw[means..means + d].iter().map(|&m| f64::from(m)).collect();
            weight + support.log_mass(&mean, &inverse(&self.factor(raw, k), d), lattice)
        };
        log_sum_exp(&self.log_weights(raw).into_iter().enumerate().map(inside).collect::<Vec<_>>())
    }

    /// Mixture over `u = centre + scale * v`.
    ///
    /// # Errors
    /// [`MixtureError`] if a weight, mean or covariance is invalid.
    pub fn mixture(&self, raw: &[f32], centre: &[f64], scale: &[f64]) -> Result<Mixture, MixtureError> {
        let (weights, means, covariances) = self.parts(raw, centre, scale);
        Mixture::new(&weights, means, covariances)
    }
}

/// Inverse of the lower triangular `factor` (D x D, row-major) with a positive diagonal, by forward substitution.
fn inverse(factor: &[f64], d: usize) -> Vec<f64> {
    let mut inverse = vec![0.0; d * d];
    for i in 0..d {
        for j in 0..=i {
            let known: f64 = (j..i).map(|l| factor[i * d + l] * inverse[l * d + j]).sum();
            inverse[i * d + j] = (f64::from(u8::from(i == j)) - known) / factor[i * d + i];
        }
    }
    inverse
}

/// Bounded logarithm of a diagonal element.
fn bend(raw: f64) -> f64 {
    DIAGONAL_LIMIT * (raw / DIAGONAL_LIMIT).tanh()
}

/// Derivative of [`bend`].
fn bend_slope(raw: f64) -> f64 {
    1.0 - (raw / DIAGONAL_LIMIT).tanh().powi(2)
}

/// Raw output whose bounded logarithm is `bent`, clamped to the inside of the bound.
fn unbend(bent: f64) -> f64 {
    DIAGONAL_LIMIT * (bent / DIAGONAL_LIMIT).clamp(-MOST_BENT, MOST_BENT).atanh()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    fn raw(head: &MixtureHead, stream: u64) -> Vec<f32> {
        let mut rng = seed::rng(21, stream);
        (0..head.outputs()).map(|_| 0.7 * rng.sample::<f32, _>(StandardNormal)).collect()
    }

    #[test]
    fn the_density_integrates_to_one() {
        // Midpoints over +-40 with steps of 1/20: the standard deviations of the components lie between e^-2 and e^2.
        let line = |i: usize| -40.0 + (i as f64 + 0.5) / 20.0;
        for stream in 0..3 {
            let one = MixtureHead { components: 3, dimension: 1 };
            let r = raw(&one, stream);
            let sum: f64 = (0..1600).map(|i| (-one.loss(&r, &[line(i)], 1.0, None)).exp() / 20.0).sum();
            assert!((sum - 1.0).abs() < 1e-6, "1-D: {sum}");
            let two = MixtureHead { components: 2, dimension: 2 };
            let r = raw(&two, stream);
            let cell = |i: usize| (-two.loss(&r, &[line(i / 1600), line(i % 1600)], 1.0, None)).exp() / 400.0;
            let sum: f64 = (0..1600 * 1600).map(cell).sum();
            assert!((sum - 1.0).abs() < 1e-4, "2-D: {sum}");
        }
    }

    #[test]
    fn parts_are_the_mixture_whose_density_is_the_loss() {
        let head = MixtureHead { components: 4, dimension: 3 };
        let r = raw(&head, 9);
        let (centre, scale) = ([0.2, 0.5, 0.9], [0.1, 0.5, 2.0]);
        let mixture = head.mixture(&r, &centre, &scale).unwrap();
        let mut rng = seed::rng(22, 0);
        for _ in 0..50 {
            let v: Vec<f64> = (0..3).map(|_| 2.0 * rng.sample::<f64, _>(StandardNormal)).collect();
            let u: Vec<f64> = (0..3).map(|i| centre[i] + scale[i] * v[i]).collect();
            let volume: f64 = scale.iter().map(|s: &f64| s.ln()).sum();
            let (density, loss) = (mixture.log_density(&u), head.loss(&r, &v, 1.0, None));
            assert!((density + volume + loss).abs() < 1e-7 * (1.0 + loss.abs()), "{density} + {volume}, {loss}");
        }
    }

    #[test]
    fn covariance_is_the_inverse_of_the_factors_square() {
        let head = MixtureHead { components: 1, dimension: 2 };
        // Logit; means 1, -1; diagonals 2 and 1/2, before the bend; 3 below them: A = [2 0; 3 0.5].
        let raw = |diagonal: f64| unbend(diagonal.ln()) as f32;
        let r = [0.0, 1.0, -1.0, raw(2.0), raw(0.5), 3.0];
        let (weights, means, covariances) = head.parts(&r, &[10.0, 20.0], &[1.0, 2.0]);
        assert_eq!((weights[0], means[0].as_slice()), (1.0, &[11.0, 18.0][..]));
        // A^-1 = [1/2 0; -3 2], scaled by (1, 2) from the left: L = [1/2 0; -6 4]; L L^T.
        let exact = [0.25, -3.0, -3.0, 52.0];
        let worst = covariances[0].iter().zip(exact).map(|(c, e)| (c - e).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-4, "{}", covariances[0]);
    }

    #[test]
    fn the_gradient_by_raw_outputs_is_that_of_finite_differences() {
        const STEP: f32 = 1.0 / 256.0;
        let head = MixtureHead { components: 3, dimension: 3 };
        let r = raw(&head, 10);
        let v = [0.3, -0.8, 0.5];
        let mut gradient = vec![0.0; head.outputs()];
        head.loss(&r, &v, 0.4, Some(&mut gradient));
        for i in 0..head.outputs() {
            let at = |step: f32| {
                let mut moved = r.clone();
                moved[i] += step;
                (head.loss(&moved, &v, 0.4, None), f64::from(moved[i]))
            };
            let ((above, to), (below, from)) = (at(STEP), at(-STEP));
            let difference = 0.4 * (above - below) / (to - from);
            // The loss is in double precision: the error is that of the central difference, STEP^2 / 6 times a third
            // derivative of order 10.
            assert!((difference - f64::from(gradient[i])).abs() < 3e-4, "{i}: {difference} against {}", gradient[i]);
        }
    }

    #[test]
    fn outputs_of_any_size_make_a_mixture_that_can_be_written_and_read() {
        let head = MixtureHead { components: 2, dimension: 4 };
        for (stream, size) in (0..200).map(|i| (i, 10f32.powi(i as i32 % 6))) {
            let raw: Vec<f32> = raw(&head, stream).iter().map(|v| v * size).collect();
            let mixture =
                head.mixture(&raw, &[0.5; 4], &[0.1, 0.2, 0.3, 1e-3]).unwrap_or_else(|e| panic!("{size}: {e}"));
            let text = serde_json::to_string(&mixture).unwrap();
            serde_json::from_str::<Mixture>(&text).unwrap_or_else(|e| panic!("{size}: {e}"));
        }
    }

    #[test]
    fn precisions_stay_bounded_and_keep_a_gradient() {
        let head = MixtureHead { components: 1, dimension: 1 };
        for (far, bound) in [(40.0, (-DIAGONAL_LIMIT).exp()), (-40.0, DIAGONAL_LIMIT.exp())] {
            let sd = head.parts(&[0.0, 0.0, far], &[0.0], &[1.0]).2[0][(0, 0)].sqrt();
            assert!((sd / bound - 1.0).abs() < 1e-3, "{far}: {sd} against {bound}");
            let mut gradient = [0.0; 3];
            assert!(head.loss(&[0.0, 0.0, far], &[3.0], 1.0, Some(&mut gradient)).is_finite());
            assert!(gradient[2] != 0.0 && gradient.iter().all(|g| g.is_finite()), "{gradient:?}");
        }
    }
}
