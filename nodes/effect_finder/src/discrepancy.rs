//! What no effect explains: a smooth error in time that each measured quantity may have beside its noise.
//!
//! It is a Gaussian process with the Matern covariance of order 3/2 (Kennedy and O'Hagan 2001, "Bayesian calibration of
//! computer models"), the same for all quantities in units of their noise, and independent between them. Added to the
//! noise's covariance, it competes with the effects: where it explains the data better than any of them, none of them is it.

use crate::case::{Case, Channel};
use crate::fit::Fit;
use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Standard deviations that are tried, in those of the noise.
const SDS: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
/// Times over which it changes that are tried, s.
const TIMES_S: [f64; 3] = [0.1, 0.4, 1.6];

/// A discrepancy of one size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Discrepancy {
    /// Standard deviation, in those of the noise.
    pub sd: f64,
    /// Time over which it changes, s.
    pub time_s: f64,
}

impl Discrepancy {
    /// All that are tried, each as likely beforehand as any other.
    pub fn all() -> Vec<Self> {
        SDS.iter().flat_map(|&sd| TIMES_S.map(|time_s| Self { sd, time_s })).collect()
    }

    /// Covariance of two values `distance_s` apart, in variances of the noise.
    pub fn covariance(&self, distance_s: f64) -> f64 {
        let d = 3f64.sqrt() * distance_s.abs() / self.time_s;
        self.sd * self.sd * (1.0 + d) * (-d).exp()
    }
}

/// Turns residuals in standard deviations of white noise into such of noise and discrepancy together, one factor an episode.
#[derive(Debug, Clone)]
pub struct Whitening {
    episodes: Vec<Factor>,
}

/// The Cholesky factor of the covariance of one quantity's values in an episode; all its quantities have the same.
#[derive(Debug, Clone)]
struct Factor {
    /// Number of quantities.
    quantities: usize,
    cholesky: Cholesky<f64, Dyn>,
}

impl Factor {
    /// Frames in the episode.
    fn frames(&self) -> usize {
        self.cholesky.l_dirty().nrows()
    }

    /// Whitens the rows of an episode: frame by frame, a frame's quantities together.
    fn whiten(&self, mut rows: DMatrixViewMut<'_, f64>) {
        for quantity in 0..self.quantities {
            let mut own =
                DMatrix::from_fn(self.frames(), rows.ncols(), |i, j| rows[(quantity + self.quantities * i, j)]);
            // The diagonal of a factor has no zeros.
            self.cholesky.l_dirty().solve_lower_triangular_mut(&mut own);
            for i in 0..self.frames() {
                rows.row_mut(quantity + self.quantities * i).copy_from(&own.row(i));
            }
        }
    }
}

impl Whitening {
    /// For episodes with noise and `discrepancy`; none where the covariance is no positive matrix.
    pub fn new(cases: &[Case], discrepancy: Discrepancy) -> Option<Self> {
        let factor = |(episode, case): (usize, &Case)| {
            let channels = case.channels(episode);
            let quantities = channels.iter().take_while(|c| c.frame == 0).count().max(1);
            let times: Vec<f64> = channels.iter().step_by(quantities).map(|c: &Channel| c.time_s).collect();
            let n = times.len();
            let white = |i: usize, j: usize| f64::from(u8::from(i == j));
            let covariance = DMatrix::from_fn(n, n, |i, j| white(i, j) + discrepancy.covariance(times[i] - times[j]));
            Some(Factor { quantities, cholesky: covariance.cholesky()? })
        };
        Some(Self { episodes: cases.iter().enumerate().map(factor).collect::<Option<_>>()? })
    }

    /// Logarithm of the determinant of the covariance, in variances of the noise.
    pub fn log_determinant(&self) -> f64 {
        let of = |f: &Factor| {
            let diagonal = f.cholesky.l_dirty().diagonal();
            2.0 * f.quantities as f64 * diagonal.iter().map(|l| l.ln()).sum::<f64>()
        };
        self.episodes.iter().map(of).sum()
    }

    /// Whitens rows that are ordered as residuals are: by episode, by frame, by quantity.
    pub fn apply(&self, rows: &mut DMatrix<f64>) {
        let (mut from, columns) = (0, rows.ncols());
        for factor in &self.episodes {
            let count = factor.quantities * factor.frames();
            factor.whiten(rows.view_mut((from, 0), (count, columns)));
            from += count;
        }
    }

    /// The fit as noise and discrepancy together see it: at the same point, in their standard deviations.
    pub fn of(&self, fit: &Fit) -> Fit {
        let columns = fit.jacobian.ncols();
        let mut rows = fit.jacobian.clone().insert_column(columns, 0.0);
        rows.set_column(columns, &fit.residuals);
        self.apply(&mut rows);
        let residuals: DVector<f64> = rows.column(columns).into_owned();
        let jacobian = rows.remove_column(columns);
        Fit {
            point: fit.point.clone(),
            cost: residuals.norm_squared(),
            residuals,
            jacobian,
            tracks: fit.tracks.clone(),
        }
    }

    /// A draw of noise and discrepancy together in standard deviations of the noise, rows as those of residuals.
    pub fn draw<R: Rng>(&self, rng: &mut R) -> DVector<f64> {
        let mut all = Vec::new();
        for factor in &self.episodes {
            let n = factor.frames();
            let z = DMatrix::from_fn(n, factor.quantities, |_, _| -> f64 { StandardNormal.sample(rng) });
            let l = factor.cholesky.l();
            let values = l * z;
            all.extend((0..n).flat_map(|i| (0..factor.quantities).map(move |q| (i, q))).map(|at| values[at]));
        }
        DVector::from_vec(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};
    use catenary_core::seed;

    fn cases() -> Vec<Case> {
        let case = toy::case(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        vec![case.clone(), case]
    }

    fn fit(residuals: DVector<f64>) -> Fit {
        let jacobian = DMatrix::from_fn(residuals.len(), 2, |i, j| ((i + 3 * j) as f64).sin());
        Fit { point: vec![0.5; 2], cost: residuals.norm_squared(), residuals, jacobian, tracks: Vec::new() }
    }

    #[test]
    fn draws_are_white_once_they_are_whitened() {
        let whitening = Whitening::new(&cases(), Discrepancy { sd: 5.0, time_s: 0.4 }).unwrap();
        let mut rng = seed::rng(41, 0);
        let rows = 2 * 8 * toy::FRAMES;
        let (mut raw, mut white, mut neighbours) = (0.0, 0.0, 0.0);
        for _ in 0..200 {
            let draw = whitening.draw(&mut rng);
            assert_eq!(draw.len(), rows);
            raw += draw.norm_squared() / (200 * rows) as f64;
            let whitened = whitening.of(&fit(draw)).residuals;
            white += whitened.norm_squared() / (200 * rows) as f64;
            let products = whitened.iter().zip(whitened.iter().skip(8)).map(|(a, b)| a * b);
            neighbours += products.sum::<f64>() / (200 * rows) as f64;
        }
        // Standard errors over 64000 values: 0.006 of the white ones; a few hundred independent ones of the raw.
        assert!((raw / 26.0 - 1.0).abs() < 0.1, "{raw}");
        assert!((white - 1.0).abs() < 0.025 && neighbours.abs() < 0.02, "{white} {neighbours}");
    }

    /// The density of a vector under a covariance does not depend on how it is computed.
    #[test]
    fn whitening_and_its_determinant_are_those_of_the_covariance() {
        let cases = [cases().remove(0)];
        let discrepancy = Discrepancy { sd: 2.0, time_s: 0.3 };
        let whitening = Whitening::new(&cases, discrepancy).unwrap();
        let channels = cases[0].channels(0);
        let n = channels.len();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let (a, b) = (channels[i], channels[j]);
            let smooth = if a.quantity == b.quantity { discrepancy.covariance(a.time_s - b.time_s) } else { 0.0 };
            smooth + f64::from(u8::from(i == j))
        });
        let whole = covariance.cholesky().unwrap();
        let fit = fit(DVector::from_fn(n, |i, _| (0.7 * i as f64).cos()));
        let whitened = whitening.of(&fit);
        let expected = fit.residuals.dot(&whole.solve(&fit.residuals));
        assert!((whitened.cost / expected - 1.0).abs() < 1e-9, "{} {expected}", whitened.cost);
        let curvature = fit.jacobian.transpose() * whole.solve(&fit.jacobian);
        assert!((whitened.curvature() - curvature.clone()).norm() < 1e-9 * curvature.norm());
        let log_determinant: f64 = 2.0 * whole.l().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        assert!((whitening.log_determinant() - log_determinant).abs() < 1e-8, "{log_determinant}");
    }
}
