//! Steps of least squares that stay within the unit cube.

use super::Fit;
use nalgebra::{DMatrix, DVector};

/// Most rounds of a linear descent: each takes a coordinate to its edge, or ends it.
const LINEAR_ROUNDS: usize = 50;
/// A linear descent ends where a round lowers the cost by less than this share of it.
const LINEAR_DECREASE: f64 = 1e-9;
/// Share of the coordinates' range that is added to the curvature of directions that change nothing.
const RIDGE: f64 = 1e-6;

impl Fit {
    /// Where the cost within the priors' support would be least if the simulator were linear about this point.
    #[must_use]
    pub fn descended(mut self) -> Self {
        for _ in 0..LINEAR_ROUNDS {
            let point = stepped(&self, 0.0);
            let residuals = &self.residuals - &self.jacobian * self.way_to(&point);
            let cost = residuals.norm_squared();
            if self.cost - cost <= LINEAR_DECREASE * self.cost {
                break;
            }
            (self.point, self.residuals, self.cost) = (point, residuals, cost);
        }
        self
    }
}

/// Whether a coordinate `u` lies at an edge of its range, and the cost, whose gradient by it is `g` or a multiple, is less
/// beyond it.
pub fn presses(u: f64, g: f64) -> bool {
    (u <= 0.0 && g > 0.0) || (u >= 1.0 && g < 0.0)
}

/// How much lower the cost would be at `trial` if the simulator were linear.
pub(super) fn predicted_decrease(fit: &Fit, trial: &[f64]) -> f64 {
    fit.cost - (&fit.residuals - &fit.jacobian * fit.way_to(trial)).norm_squared()
}

/// Where a damped step leads to.
pub(super) fn stepped(fit: &Fit, damping: f64) -> Vec<f64> {
    fit.point.iter().zip(step(fit, damping).iter()).map(|(u, d)| (u + d).clamp(0.0, 1.0)).collect()
}

/// A damped step that does not leave the unit cube from its faces: coordinates at an edge that would go beyond it are held.
fn step(fit: &Fit, damping: f64) -> DVector<f64> {
    let (gradient, curvature) = (fit.gradient(), fit.curvature());
    let n = gradient.len();
    let mut free: Vec<usize> = (0..n).filter(|&i| !presses(fit.point[i], gradient[i])).collect();
    let mut step = DVector::zeros(n);
    loop {
        let k = free.len();
        let mut matrix = DMatrix::from_fn(k, k, |i, j| curvature[(free[i], free[j])]);
        for i in 0..k {
            matrix[(i, i)] += damping * curvature[(free[i], free[i])] + RIDGE;
        }
        let right = DVector::from_fn(k, |i, _| -gradient[free[i]]);
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { return step };
        // A coordinate at an edge that the whole step drives outward is held, too, and the others are solved for again.
        let leaves = |(i, d): &(&usize, &f64)| presses(fit.point[**i], -**d);
        let held: Vec<usize> = free.iter().zip(solved.iter()).filter(leaves).map(|(&i, _)| i).collect();
        if held.is_empty() {
            step.fill(0.0);
            free.iter().zip(solved.iter()).for_each(|(&i, d)| step[i] = *d);
            return step;
        }
        free.retain(|i| !held.contains(i));
    }
}
