//! Damped Gauss-Newton steps within the unit cube.

use super::problem::Fit;
use nalgebra::{DMatrix, DVector};

/// Most rounds of a linear minimisation. Each round moves a coordinate to its bound, or ends it.
const LINEAR_ROUNDS: usize = 50;
/// Relative decrease of the cost under which a linear minimisation ends.
const LINEAR_DECREASE: f64 = 1e-9;
/// Ridge added to the curvature in unit coordinates, so that directions without information have a finite step. Data
/// that tell a coordinate to within its whole range add 1.
const RIDGE: f64 = 1e-6;

impl Fit {
    /// Minimum of the linearised cost within the priors' support.
    #[must_use]
    pub fn linear_minimum(mut self) -> Self {
        for _ in 0..LINEAR_ROUNDS {
            let point = damped_point(&self, 0.0);
            let residuals = &self.residuals - &self.jacobian * self.step_to(&point);
            let cost = residuals.norm_squared();
            // A step is cut at the first bounds it meets, so that several may be needed.
            if self.cost - cost <= LINEAR_DECREASE * self.cost {
                break;
            }
            (self.point, self.residuals, self.cost) = (point, residuals, cost);
        }
        self
    }
}

/// Returns whether the bound at coordinate `u` is active: the coordinate lies at an end of 0 to 1, and the cost falls
/// beyond it. `g` is the derivative of the cost, up to a positive factor.
pub fn is_bound_active(u: f64, g: f64) -> bool {
    (u <= 0.0 && g > 0.0) || (u >= 1.0 && g < 0.0)
}

/// Decrease of the linearised cost from the fit to `trial`.
pub(super) fn predicted_decrease(fit: &Fit, trial: &[f64]) -> f64 {
    fit.cost - (&fit.residuals - &fit.jacobian * fit.step_to(trial)).norm_squared()
}

/// Point after a damped step.
pub(super) fn damped_point(fit: &Fit, damping: f64) -> Vec<f64> {
    fit.point.iter().zip(damped_step(fit, damping).iter()).map(|(u, d)| (u + d).clamp(0.0, 1.0)).collect()
}

/// Damped Gauss-Newton step within the unit cube. Coordinates at active bounds are held.
fn damped_step(fit: &Fit, damping: f64) -> DVector<f64> {
    let (gradient, curvature) = (fit.gradient(), fit.curvature());
    let n = gradient.len();
    let mut free: Vec<usize> = (0..n).filter(|&i| !is_bound_active(fit.point[i], gradient[i])).collect();
    let mut step = DVector::zeros(n);
    loop {
        let k = free.len();
        let mut matrix = DMatrix::from_fn(k, k, |i, j| curvature[(free[i], free[j])]);
        for i in 0..k {
            matrix[(i, i)] += damping * curvature[(free[i], free[i])] + RIDGE;
        }
        let right = DVector::from_fn(k, |i, _| -gradient[free[i]]);
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { return step };
        // A coordinate at its bound that the full step would push outward is held, too, and the others are solved for
        // again.
        let leaves = |(i, d): &(&usize, &f64)| is_bound_active(fit.point[**i], -**d);
        let held: Vec<usize> = free.iter().zip(solved.iter()).filter(leaves).map(|(&i, _)| i).collect();
        if held.is_empty() {
            step.fill(0.0);
            free.iter().zip(solved.iter()).for_each(|(&i, d)| step[i] = *d);
            return step;
        }
        // Each pass holds at least one more coordinate, so that the loop ends.
        free.retain(|i| !held.contains(i));
    }
}
