//! The mixture density head: raw outputs of the last layer -> a mixture of K Gaussians over D coordinates.
//!
//! Raw outputs of one track, in order: K logits of the weights; K x D means; K x D logarithms of the diagonals and
//! K x D(D-1)/2 entries below the diagonals (row by row) of lower triangular factors A. Component k has the precision
//! matrix `A^T A`, so it is positive definite whatever the outputs are. The logarithms of the diagonals are bent to
//! +-[`DIAGONAL_LIMIT`] by `L tanh(raw / L)`, which bounds precisions without ever stopping their gradient.
//! The coordinates here are whitened ones, `v = (u - centre) / scale`.

use catenary_core::Mixture;
use catenary_core::mixture::{MixtureError, log_sum_exp};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Bound of the logarithm of a diagonal element of A: standard deviations down to e^-7 of the whitened unit.
pub const DIAGONAL_LIMIT: f64 = 7.0;

const LN_TAU: f64 = 1.837_877_066_409_345_3;

/// Shape of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MixtureHead {
    /// K.
    pub components: usize,
    /// D.
    pub dimension: usize,
}

/// One component, read from raw outputs.
struct Component {
    /// `v - mean`.
    difference: Vec<f64>,
    /// A, row-major, D x D.
    factor: Vec<f64>,
    /// `A (v - mean)`.
    whitened: Vec<f64>,
    log_density: f64,
}

impl MixtureHead {
    /// Entries below the diagonal of one factor.
    fn below(&self) -> usize {
        self.dimension * (self.dimension - 1) / 2
    }

    /// Number of raw outputs.
    pub fn outputs(&self) -> usize {
        self.components * (1 + 2 * self.dimension + self.below())
    }

    /// First raw output of the means, of the diagonals, of the entries below them.
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

    /// The factor A of component `k`, row-major.
    fn factor(&self, raw: &[f32], k: usize) -> Vec<f64> {
        let d = self.dimension;
        let [_, diagonals, belows] = self.offsets();
        let mut factor = vec![0.0; d * d];
        let mut below = raw[belows + k * self.below()..].iter();
        for i in 0..d {
            for j in 0..i {
                factor[i * d + j] = below.next().map_or(0.0, |&v| f64::from(v));
            }
            factor[i * d + i] = bend(raw[diagonals + k * d + i]).exp();
        }
        factor
    }

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

    /// Negative log density of the mixture of `raw` at `v`. Where `gradient` is given (one value a raw output), `weight`
    /// times the derivatives by the raw outputs are written to it.
    pub fn loss(&self, raw: &[f32], v: &[f64], weight: f64, gradient: Option<&mut [f32]>) -> f64 {
        let log_weights = self.log_weights(raw);
        let components: Vec<Component> = (0..self.components).map(|k| self.component(raw, k, v)).collect();
        let terms: Vec<f64> = log_weights.iter().zip(&components).map(|(w, c)| w + c.log_density).collect();
        let total = log_sum_exp(&terms);
        let Some(gradient) = gradient else { return -total };
        let d = self.dimension;
        let [means, diagonals, belows] = self.offsets();
        for (k, c) in components.iter().enumerate() {
            let responsibility = (terms[k] - total).exp();
            gradient[k] = (weight * (log_weights[k].exp() - responsibility)) as f32;
            let scale = weight * responsibility;
            let mut below = belows + k * self.below();
            for i in 0..d {
                let by_mean: f64 = (i..d).map(|row| c.factor[row * d + i] * c.whitened[row]).sum();
                gradient[means + k * d + i] = (-scale * by_mean) as f32;
                let by_log = 1.0 - c.whitened[i] * c.factor[i * d + i] * c.difference[i];
                gradient[diagonals + k * d + i] = (-scale * by_log * bend_slope(raw[diagonals + k * d + i])) as f32;
                for j in 0..i {
                    gradient[below] = (scale * c.whitened[i] * c.difference[j]) as f32;
                    below += 1;
                }
            }
        }
        -total
    }

    /// The mixture over `u = centre + scale * v`: log weights, means and covariances.
    #[allow(clippy::type_complexity, reason = "the parts of a mixture, which an ensemble pools")]
    pub fn parts(
        &self,
        raw: &[f32],
        centre: &[f64],
        scale: &[f64],
    ) -> Result<(Vec<f64>, Vec<DVector<f64>>, Vec<DMatrix<f64>>), MixtureError> {
        let d = self.dimension;
        let weights = self.log_weights(raw).iter().map(|w| w.exp()).collect();
        let mut means = Vec::with_capacity(self.components);
        let mut covariances = Vec::with_capacity(self.components);
        for k in 0..self.components {
            let first = self.offsets()[0] + k * d;
            means.push(DVector::from_fn(d, |i, _| centre[i] + scale[i] * f64::from(raw[first + i])));
            let factor = DMatrix::from_row_slice(d, d, &self.factor(raw, k));
            let inverse = factor.solve_lower_triangular(&DMatrix::identity(d, d)).ok_or(MixtureError::Component(k))?;
            let root = DMatrix::from_fn(d, d, |i, j| scale[i] * inverse[(i, j)]);
            covariances.push(&root * root.transpose());
        }
        Ok((weights, means, covariances))
    }

    /// The mixture over `u = centre + scale * v`.
    pub fn mixture(&self, raw: &[f32], centre: &[f64], scale: &[f64]) -> Result<Mixture, MixtureError> {
        let (weights, means, covariances) = self.parts(raw, centre, scale)?;
        Mixture::new(&weights, means, covariances)
    }
}

/// The bounded logarithm of a diagonal element.
fn bend(raw: f32) -> f64 {
    DIAGONAL_LIMIT * (f64::from(raw) / DIAGONAL_LIMIT).tanh()
}

fn bend_slope(raw: f32) -> f64 {
    1.0 - (f64::from(raw) / DIAGONAL_LIMIT).tanh().powi(2)
}
