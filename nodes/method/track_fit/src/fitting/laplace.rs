//! Laplace approximation of the posterior: a Gaussian around the fit, truncated at the bounds of the priors.

use super::problem::Fit;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use std::ops::Range;

/// Precision of a coordinate without data: a uniform distribution on 0 to 1 has variance 1/12.
pub const PRIOR_PRECISION: f64 = 12.0;
/// Precision of a coordinate whose prior is counted elsewhere; it keeps the matrix positive definite.
const NO_PRECISION: f64 = 1e-6;
/// Rejection draws before the sampler changes to single coordinates.
const TRIES: usize = 50;
/// Sweeps of the Gibbs sampler.
const SWEEPS: usize = 50;

/// Gaussian around a fit, in unit coordinates.
#[derive(Debug, Clone)]
pub struct Laplace {
    mean: DVector<f64>,
    matrix: DMatrix<f64>,
    precision: Cholesky<f64, Dyn>,
}

impl Laplace {
    /// Posterior around `fit` under uniform priors; none if the matrix is not positive definite.
    pub fn of(fit: &Fit) -> Option<Self> {
        Self::with_precision(fit, |_| PRIOR_PRECISION)
    }

    /// Likelihood around `fit`, without the width of the priors but for the coordinates in `with_prior`.
    pub fn of_likelihood(fit: &Fit, with_prior: Range<usize>) -> Option<Self> {
        Self::with_precision(fit, |i| if with_prior.contains(&i) { PRIOR_PRECISION } else { NO_PRECISION })
    }

    /// Posterior with the variances of `sds` added to the coordinates from `first` on. Returns it unchanged if all are
    /// zero.
    #[must_use]
    pub fn widened(self, first: usize, sds: &[f64]) -> Self {
        if sds.iter().all(|sd| *sd == 0.0) {
            return self;
        }
        // Variances add in the covariance, not in the precision.
        let mut covariance = self.precision.inverse();
        sds.iter().enumerate().for_each(|(i, sd)| covariance[(first + i, first + i)] += sd * sd);
        let widened = covariance.cholesky().and_then(|c| {
            let matrix = c.inverse();
            Some(Self { mean: self.mean.clone(), precision: matrix.clone().cholesky()?, matrix })
        });
        widened.unwrap_or(self)
    }

    fn with_precision(fit: &Fit, own: impl Fn(usize) -> f64) -> Option<Self> {
        let mut matrix = fit.curvature();
        (0..matrix.nrows()).for_each(|i| matrix[(i, i)] += own(i));
        let mean = DVector::from_column_slice(&fit.point);
        Some(Self { mean, precision: matrix.clone().cholesky()?, matrix })
    }

    /// Standard deviation of a coordinate.
    pub fn sd(&self, column: usize) -> f64 {
        let mut unit = DVector::zeros(self.mean.len());
        unit[column] = 1.0;
        // With precision L L^T, the variance is |L^-1 e|^2. A Cholesky factor has no zeros on its diagonal.
        self.precision.l_dirty().solve_lower_triangular_mut(&mut unit);
        unit.norm()
    }

    /// Covariance of the coordinates in `columns`, the others free.
    pub fn covariance(&self, columns: Range<usize>) -> DMatrix<f64> {
        let mut units = DMatrix::zeros(self.mean.len(), columns.len());
        columns.enumerate().for_each(|(i, column)| units[(column, i)] = 1.0);
        self.precision.l_dirty().solve_lower_triangular_mut(&mut units);
        units.transpose() * units
    }

    /// Correlations of the coordinates in `columns`, the others free.
    pub fn correlations(&self, columns: Range<usize>) -> DMatrix<f64> {
        let covariance = self.covariance(columns);
        // The precision of [`PRIOR_PRECISION`] or [`NO_PRECISION`] keeps the variances positive; a curvature that is not
        // finite gives a NaN, which is below every limit.
        DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
            covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt()
        })
    }

    /// Log determinant of the precision.
    pub fn log_determinant(&self) -> f64 {
        2.0 * self.precision.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>()
    }

    /// Draw within the unit cube.
    pub fn draw<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        for _ in 0..TRIES {
            let z = DVector::from_fn(self.mean.len(), |_, _| -> f64 { StandardNormal.sample(rng) });
            // With precision L L^T, L^-T z has the wanted covariance.
            let Some(d) = self.precision.l_dirty().tr_solve_lower_triangular(&z) else { break };
            let draw = &self.mean + d;
            if draw.iter().all(|u| (0.0..=1.0).contains(u)) {
                return draw.iter().copied().collect();
            }
        }
        self.draw_by_coordinates(rng)
    }

    /// Draw by a Gibbs sampler within the cube, from the mode on. With many coordinates, or some at their bounds,
    /// rejection nearly always fails.
    fn draw_by_coordinates<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        let mut u: Vec<f64> = self.mean.iter().map(|m| m.clamp(0.0, 1.0)).collect();
        for _ in 0..SWEEPS {
            for i in 0..u.len() {
                let others: f64 =
                    (0..u.len()).filter(|&j| j != i).map(|j| self.matrix[(i, j)] * (u[j] - self.mean[j])).sum();
                let precision = self.matrix[(i, i)];
                u[i] = truncated_normal(self.mean[i] - others / precision, precision.powf(-0.5), rng);
            }
        }
        u
    }
}

/// Draw from a normal distribution truncated to 0 to 1: by rejection, or with an exponential envelope in the tail
/// (Robert 1995).
fn truncated_normal<R: Rng>(mean: f64, sd: f64, rng: &mut R) -> f64 {
    // The mirror image brings the mean to the other side, so that one tail is enough.
    if mean > 1.0 {
        return 1.0 - truncated_normal(1.0 - mean, sd, rng);
    }
    let (low, high) = (-mean / sd, (1.0 - mean) / sd);
    loop {
        // Draw z in standard deviations from the mean.
        // Wide interval around the mean: plain draws are accepted often enough.
        let (z, accepted): (f64, f64) = if low <= 0.0 && high - low > 1.0 {
            (StandardNormal.sample(rng), 1.0)
        } else if low <= 0.0 || high - low < 0.1 {
            // Narrow interval: the density is nearly flat, so that uniform proposals serve.
            let z = low + (high - low) * rng.random::<f64>();
            let nearest: f64 = low.max(0.0);
            (z, (0.5 * (nearest * nearest - z * z)).exp())
        } else {
            // Tail: the exponential envelope with the best rate (Robert 1995).
            let rate = 0.5 * (low + (low * low + 4.0).sqrt());
            let z = low - rng.random::<f64>().max(f64::MIN_POSITIVE).ln() / rate;
            (z, (-0.5 * (z - rate).powi(2)).exp())
        };
        if (low..=high).contains(&z) && rng.random::<f64>() <= accepted {
            return (mean + sd * z).clamp(0.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    fn fit(point: Vec<f64>, jacobian: DMatrix<f64>) -> Fit {
        let residuals = DVector::zeros(jacobian.nrows());
        Fit { point, cost: 0.0, residuals, jacobian, tracks: Vec::new() }
    }

    fn moments(draws: &[f64]) -> (f64, f64) {
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        (mean, (draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n).sqrt())
    }

    #[test]
    fn a_likelihood_has_the_width_of_the_prior_where_it_is_asked_for() {
        let fit = fit(vec![0.5; 2], DMatrix::zeros(1, 2));
        let likelihood = Laplace::of_likelihood(&fit, 0..1).unwrap();
        assert!((likelihood.sd(0) - 12f64.sqrt().recip()).abs() < 1e-12 && likelihood.sd(1) > 100.0);
    }

    #[test]
    fn widening_adds_variances_only() {
        let jacobian = DMatrix::from_row_slice(3, 3, &[40.0, 10.0, 0.0, 0.0, 50.0, 20.0, 5.0, 0.0, 60.0]);
        let fit = Fit { point: vec![0.5; 3], cost: 0.0, residuals: DVector::zeros(3), jacobian, tracks: Vec::new() };
        let own = Laplace::of(&fit).unwrap();
        let before = own.covariance(0..3);
        let mut expected = before.clone();
        expected[(2, 2)] += 0.01;
        let after = own.clone().widened(1, &[0.0, 0.1]).covariance(0..3);
        assert!((after - expected).amax() < 1e-12);
        assert!((own.widened(1, &[0.0, 0.0]).covariance(0..3) - before).amax() == 0.0);
    }

    #[test]
    fn draws_of_a_sharp_gaussian_have_its_covariance() {
        let jacobian = DMatrix::from_row_slice(2, 2, &[100.0, 0.0, 80.0, 60.0]);
        let laplace = Laplace::of(&fit(vec![0.4, 0.6], jacobian)).unwrap();
        let mut rng = seed::rng(31, 0);
        let draws: Vec<Vec<f64>> = (0..4000).map(|_| laplace.draw(&mut rng)).collect();
        let by: Vec<Vec<f64>> = (0..4000).map(|_| laplace.draw_by_coordinates(&mut rng)).collect();
        for draws in [draws, by] {
            for i in 0..2 {
                let (mean, sd) = moments(&draws.iter().map(|d| d[i]).collect::<Vec<_>>());
                // Standard errors of 4000 draws: 1.6 % for the mean, 1.1 % for the standard deviation.
                assert!((mean - [0.4, 0.6][i]).abs() < 0.07 * laplace.sd(i), "{i}: {mean}");
                assert!((sd / laplace.sd(i) - 1.0).abs() < 0.05, "{i}: {sd} for {}", laplace.sd(i));
            }
        }
    }

    /// A half-normal distribution has its mean at sqrt(2 / pi) standard deviations.
    #[test]
    fn twenty_coordinates_at_their_bounds_are_drawn_as_half_normals() {
        let laplace = Laplace::of(&fit(vec![0.0; 20], 50.0 * DMatrix::identity(20, 20))).unwrap();
        let mut rng = seed::rng(32, 0);
        let draws: Vec<f64> = (0..200).flat_map(|_| laplace.draw(&mut rng)).collect();
        let (mean, _) = moments(&draws);
        let expected = (2.0 / std::f64::consts::PI).sqrt() * laplace.sd(0);
        assert!((mean / expected - 1.0).abs() < 0.05, "{mean} for {expected}");
        assert!(draws.iter().all(|u| (0.0..=1.0).contains(u)));
    }

    #[test]
    fn a_truncated_normal_has_its_mean_inside_and_outside_the_bounds() {
        let mut rng = seed::rng(33, 0);
        // Mean beyond the bound: nearly an exponential distribution of rate distance / variance.
        for (mean, sd, expected) in [(-1.0, 0.1, 0.0098), (2.0, 0.1, 1.0 - 0.0098), (0.5, 1e3, 0.5), (0.5, 0.01, 0.5)] {
            let draws: Vec<f64> = (0..20_000).map(|_| truncated_normal(mean, sd, &mut rng)).collect();
            let (got, spread) = moments(&draws);
            assert!((got - expected).abs() < 4.0 * spread / 20_000f64.sqrt() + 1e-4, "{mean} {sd}: {got}");
        }
    }
}
