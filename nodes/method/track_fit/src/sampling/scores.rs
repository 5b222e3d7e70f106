//! Normal scores: coordinates in which the prior is a standard normal distribution.

use crate::error::FitError;
use crate::fitting::{OnRound, Problem};
use nalgebra::DVector;
use statrs::function::erf::{erfc, erfc_inv};
use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2};

/// Least distance of a unit coordinate from 0 and 1 when it becomes a score: a score of 4.8.
const EDGE: f64 = 1e-6;
/// Points of a batch. Between batches a run may be cancelled.
const BATCH: usize = 128;

/// Likelihood of a problem in normal scores `z = Phi^-1(u)` of its unit coordinates u, with the pull of Gaussian priors, where Phi is the standard
/// normal distribution function. The bounds of the priors lie at infinity there, so that no proposal is cut.
pub struct Scores<'a> {
    problem: &'a Problem<'a>,
    measured: Vec<catenary_core::Track>,
    inflation: f64,
}

impl<'a> Scores<'a> {
    /// Likelihood of a problem, with `inflation` times the variance of the stated noise.
    pub fn of(problem: &'a Problem<'a>, inflation: f64) -> Self {
        Self { problem, measured: problem.measured(), inflation }
    }

    /// Part of a point's cost that is due to Gaussian priors.
    fn pull(&self, u: &[f64]) -> f64 {
        self.problem.unknowns.prior_residuals(u).iter().map(|(residual, ..)| residual * residual).sum()
    }

    /// Unit coordinates of scores.
    pub fn to_unit(z: &DVector<f64>) -> Vec<f64> {
        z.iter().map(|z| 0.5 * erfc(-z * FRAC_1_SQRT_2)).collect()
    }

    /// Scores of unit coordinates. Coordinates at a bound are moved inside a little.
    pub fn from_unit(u: &[f64]) -> DVector<f64> {
        DVector::from_iterator(u.len(), u.iter().map(|u| -SQRT_2 * erfc_inv(2.0 * u.clamp(EDGE, 1.0 - EDGE))))
    }

    /// Derivatives of the unit coordinates by the scores: the standard normal density.
    pub fn slopes(z: &DVector<f64>) -> DVector<f64> {
        z.map(|z| (-0.5 * z * z).exp() / (2.0 * PI).sqrt())
    }

    /// Log likelihoods at the scores, up to a constant. A point that cannot be simulated has minus infinity. A point whose log
    /// likelihood lies below its limit may have any value below the limit.
    ///
    /// # Errors
    /// [`FitError::Cancelled`] if `on_round` breaks.
    pub fn log_likelihoods(
        &self,
        points: &[DVector<f64>],
        limits: Option<&[f64]>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<f64>, FitError> {
        let mut likelihoods = Vec::with_capacity(points.len());
        for (part, chunk) in points.chunks(BATCH).enumerate() {
            let units: Vec<Vec<f64>> = chunk.iter().map(Self::to_unit).collect();
            // The noise is inflated, and Gaussian priors are not: their part of the cost stays whole.
            let kept: Vec<f64> = units.iter().map(|u| (1.0 - 1.0 / self.inflation) * self.pull(u)).collect();
            let costs = match limits {
                None => self.problem.costs(&units, &self.measured),
                Some(limits) => {
                    let own = &limits[part * BATCH..][..chunk.len()];
                    let most = |(limit, kept): (&f64, &f64)| self.inflation * (-2.0 * limit - kept);
                    let most: Vec<f64> = own.iter().zip(&kept).map(most).collect();
                    self.problem.costs_each_to(&units, &self.measured, &most)
                }
            };
            likelihoods.extend(costs.into_iter().zip(&kept).map(|(cost, kept)| -0.5 * (cost / self.inflation + kept)));
            if on_round().is_break() {
                return Err(FitError::Cancelled);
            }
        }
        Ok(likelihoods)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_and_unit_coordinates_invert_each_other() {
        let u = [1e-5, 0.1, 0.5, 0.975, 1.0 - 1e-5];
        let z = Scores::from_unit(&u);
        assert!((z[3] - 1.959_964).abs() < 1e-5, "{z}");
        for (a, b) in Scores::to_unit(&z).iter().zip(u) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
        assert!(Scores::from_unit(&[0.0, 1.0]).iter().all(|z| z.is_finite()));
        let slope = (Scores::to_unit(&DVector::from_element(1, 0.7 + 1e-6))[0]
            - Scores::to_unit(&DVector::from_element(1, 0.7))[0])
            / 1e-6;
        assert!((slope - Scores::slopes(&DVector::from_element(1, 0.7))[0]).abs() < 1e-5);
    }
}
