//! The posterior about a fit: a Gaussian cut off at the priors' edges, after Laplace.

use crate::fit::Fit;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// Precision that a coordinate has without data: a uniform distribution on 0 to 1 has a variance of a twelfth.
const PRIOR_PRECISION: f64 = 12.0;
/// Draws among which one inside the priors' support is looked for.
const TRIES: usize = 200;

/// The Gaussian about a fit, in unit coordinates.
#[derive(Debug, Clone)]
pub struct Laplace {
    mean: DVector<f64>,
    precision: Cholesky<f64, Dyn>,
}

impl Laplace {
    /// The Gaussian about `fit`; none where the curvature is no number.
    pub fn of(fit: &Fit) -> Option<Self> {
        let mut precision = fit.curvature();
        for i in 0..precision.nrows() {
            precision[(i, i)] += PRIOR_PRECISION;
        }
        let mean = DVector::from_column_slice(&fit.point);
        Some(Self { mean, precision: precision.cholesky()? })
    }

    /// Covariance of the coordinates.
    pub fn covariance(&self) -> DMatrix<f64> {
        self.precision.inverse()
    }

    /// Standard deviation of a coordinate.
    pub fn sd(&self, column: usize) -> f64 {
        self.covariance()[(column, column)].sqrt()
    }

    /// A draw within the unit cube. Where none is found, coordinates outside of it are put onto its faces.
    pub fn draw<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        let mut draw = self.mean.clone();
        for _ in 0..TRIES {
            let z = DVector::from_fn(self.mean.len(), |_, _| -> f64 { StandardNormal.sample(rng) });
            // With precision L L^T, L^-T z has the covariance wanted.
            let Some(d) = self.precision.l_dirty().tr_solve_lower_triangular(&z) else { break };
            draw = &self.mean + d;
            if draw.iter().all(|u| (0.0..=1.0).contains(u)) {
                break;
            }
        }
        draw.iter().map(|u| u.clamp(0.0, 1.0)).collect()
    }
}
