//! Model discrepancy: a smooth error in time of each measured quantity that no effect explains.
//!
//! The discrepancy is a Gaussian process with the Matern covariance of order 3/2 (Kennedy and O'Hagan 2001, "Bayesian
//! calibration of computer models"). All quantities have the same process in units of their noise, independent of each
//! other. Its covariance is added to that of the noise, so that it competes with the effects: if it explains the data
//! better than every effect, no effect is named.

use crate::data::{Channel, MeasuredEpisode};
use crate::fitting::Fit;
use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Tried standard deviations, in standard deviations of the noise.
const SDS: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
/// Tried correlation times, s.
const TIMES_S: [f64; 3] = [0.1, 0.4, 1.6];

/// Size of a discrepancy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Discrepancy {
    /// Standard deviation, in standard deviations of the noise.
    pub sd: f64,
    /// Correlation time, s.
    pub time_s: f64,
}

impl Discrepancy {
    /// Tried discrepancies, all with the same prior probability.
    pub fn all() -> Vec<Self> {
        SDS.iter().flat_map(|&sd| TIMES_S.map(|time_s| Self { sd, time_s })).collect()
    }

    /// Covariance of two values `distance_s` apart, in variances of the noise.
    pub fn covariance(&self, distance_s: f64) -> f64 {
        let d = 3f64.sqrt() * distance_s.abs() / self.time_s;
        self.sd * self.sd * (1.0 + d) * (-d).exp()
    }
}

/// Whitening by the joint covariance of noise and discrepancy, one factor an episode. It maps residuals in standard
/// deviations of the noise to white residuals.
#[derive(Debug, Clone)]
pub struct Whitening {
    episodes: Vec<Factor>,
}

/// Cholesky factor of the covariance of one quantity over an episode. All quantities of the episode share it.
#[derive(Debug, Clone)]
struct Factor {
    /// Number of quantities.
    quantities: usize,
    cholesky: Cholesky<f64, Dyn>,
}

impl Factor {
    /// Number of frames of the episode.
    fn frames(&self) -> usize {
        self.cholesky.l_dirty().nrows()
    }

    /// Whitens the rows of an episode, ordered by frame and within a frame by quantity.
    fn whiten(&self, mut rows: DMatrixViewMut<'_, f64>) {
        for quantity in 0..self.quantities {
            // Rows of one quantity lie `quantities` apart.
            let mut own =
                DMatrix::from_fn(self.frames(), rows.ncols(), |i, j| rows[(quantity + self.quantities * i, j)]);
            // A Cholesky factor has no zeros on its diagonal, so that the solution exists.
            self.cholesky.l_dirty().solve_lower_triangular_mut(&mut own);
            for i in 0..self.frames() {
                rows.row_mut(quantity + self.quantities * i).copy_from(&own.row(i));
            }
        }
    }
}

impl Whitening {
    /// Whitening for `episodes` with noise and `discrepancy`; none if a covariance is not positive definite.
    pub fn new(episodes: &[MeasuredEpisode], discrepancy: Discrepancy) -> Option<Self> {
        let factor = |(index, episode): (usize, &MeasuredEpisode)| {
            let channels = episode.channels(index);
            let quantities = channels.iter().take_while(|c| c.frame == 0).count().max(1);
            let times: Vec<f64> = channels.iter().step_by(quantities).map(|c: &Channel| c.time_s).collect();
            let n = times.len();
            // The noise is white and has unit variance in these units.
            let white = |i: usize, j: usize| f64::from(u8::from(i == j));
            let covariance = DMatrix::from_fn(n, n, |i, j| white(i, j) + discrepancy.covariance(times[i] - times[j]));
            Some(Factor { quantities, cholesky: covariance.cholesky()? })
        };
        Some(Self { episodes: episodes.iter().enumerate().map(factor).collect::<Option<_>>()? })
    }

    /// Log determinant of the covariance, in variances of the noise.
    pub fn log_determinant(&self) -> f64 {
        let of = |f: &Factor| {
            let diagonal = f.cholesky.l_dirty().diagonal();
            2.0 * f.quantities as f64 * diagonal.iter().map(|l| l.ln()).sum::<f64>()
        };
        self.episodes.iter().map(of).sum()
    }

    /// Whitens rows that are ordered as residuals: by episode, by frame, by quantity.
    pub fn apply(&self, rows: &mut DMatrix<f64>) {
        let (mut from, columns) = (0, rows.ncols());
        for factor in &self.episodes {
            let count = factor.quantities * factor.frames();
            factor.whiten(rows.view_mut((from, 0), (count, columns)));
            from += count;
        }
    }

    /// Whitened fit at the same point.
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

    /// Draw of noise plus discrepancy, in standard deviations of the noise, ordered as residuals.
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

    fn episodes() -> Vec<MeasuredEpisode> {
        let episode = toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        vec![episode.clone(), episode]
    }

    fn fit(residuals: DVector<f64>) -> Fit {
        let jacobian = DMatrix::from_fn(residuals.len(), 2, |i, j| ((i + 3 * j) as f64).sin());
        Fit { point: vec![0.5; 2], cost: residuals.norm_squared(), residuals, jacobian, tracks: Vec::new() }
    }

    #[test]
    fn draws_are_white_once_they_are_whitened() {
        let whitening = Whitening::new(&episodes(), Discrepancy { sd: 5.0, time_s: 0.4 }).unwrap();
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
        // Standard errors over 64000 values: 0.006 of the white mean square; the raw values have a few hundred
        // independent ones.
        assert!((raw / 26.0 - 1.0).abs() < 0.1, "{raw}");
        assert!((white - 1.0).abs() < 0.025 && neighbours.abs() < 0.02, "{white} {neighbours}");
    }

    /// The density of a vector under a covariance does not depend on the way of computing it.
    #[test]
    fn whitening_and_its_determinant_are_those_of_the_covariance() {
        let episodes = [episodes().remove(0)];
        let discrepancy = Discrepancy { sd: 2.0, time_s: 0.3 };
        let whitening = Whitening::new(&episodes, discrepancy).unwrap();
        let channels = episodes[0].channels(0);
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
