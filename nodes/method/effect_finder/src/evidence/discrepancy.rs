//! Model discrepancy: an error of the keypoints that is smooth in time and along the object, and that no effect explains.
//!
//! The discrepancy is a Gaussian process with the Matern covariance of order 3/2 in time (Kennedy and O'Hagan 2001,
//! "Bayesian calibration of computer models"). Along the object it is the sum of three processes of equal mean variance:
//! a curvature error that is white along the centre line, whose displacement grows towards the tip; a displacement of all
//! keypoints; and an error of each keypoint by itself. A model that lacks something moves all keypoints together: if they
//! counted as independent, every comparison would be certain. Both image axes, and the coordinates of the pose and of the wrench, are
//! independent. The covariance is added to that of the noise, so that the discrepancy competes with the effects: if it
//! explains the data better than every effect, no effect is named.

use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn, SMatrix, SVector, SymmetricEigen};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use track_fit::data::{Channel, MeasuredEpisode, Quantity};
use track_fit::fitting::Fit;

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

    /// Covariance of two values of a keypoint `distance_s` apart, in variances of the noise: the mean over the keypoints.
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

/// Number of keypoints, and of their image axes.
const POINTS: usize = 4;
const AXES: usize = 2;

/// Places of the keypoints along the object, as shares of its length.
// Models may place them elsewhere; the covariance along the object is only a coarse one.
const PLACES: [f64; POINTS] = [0.25, 0.5, 0.75, 1.0];

/// Covariance of the keypoints' errors along the object, with a mean variance of 1.
fn along_the_object() -> SMatrix<f64, POINTS, POINTS> {
    // Displacement by white curvature: the integral of (a - u) (b - u) over u from 0 to the smaller of a and b.
    let bending = SMatrix::from_fn(|i, j| {
        let (a, b) = (PLACES[i].min(PLACES[j]), PLACES[i].max(PLACES[j]));
        a * a * (3.0 * b - a) / 6.0
    });
    let parts = [bending, SMatrix::repeat(1.0), SMatrix::identity()];
    parts
        .iter()
        .map(|part: &SMatrix<f64, POINTS, POINTS>| part * (POINTS as f64 / part.trace() / parts.len() as f64))
        .sum()
}

/// Cholesky factors of the covariance of one episode. In the modes of the covariance along the object, the errors are
/// independent of each other; each mode has its own factor over time.
#[derive(Debug, Clone)]
struct Factor {
    /// Number of quantities of a frame: keypoints, point by point and axis by axis, then the pose, then the wrench.
    quantities: usize,
    /// True if the keypoints are among them.
    is_seen: bool,
    /// Modes of the keypoints' errors along the object, one a column.
    modes: SMatrix<f64, POINTS, POINTS>,
    /// Factor over time of each mode, and of a coordinate of the pose or of the wrench.
    over_time: [Cholesky<f64, Dyn>; POINTS + 1],
}

impl Factor {
    /// Factor of an episode with frames at `times_s`; none if a covariance is not positive definite.
    fn new(times_s: &[f64], (quantities, is_seen): (usize, bool), discrepancy: Discrepancy) -> Option<Self> {
        let SymmetricEigen { eigenvectors: modes, eigenvalues } = along_the_object().symmetric_eigen();
        let n = times_s.len();
        let smooth = DMatrix::from_fn(n, n, |i, j| discrepancy.covariance(times_s[i] - times_s[j]));
        // The noise is white and has unit variance in these units.
        let factor = |variance: f64| (DMatrix::identity(n, n) + variance * &smooth).cholesky();
        let [a, b, c, d] = [0, 1, 2, 3].map(|mode| factor(eigenvalues[mode]));
        Some(Self { quantities, is_seen, modes, over_time: [a?, b?, c?, d?, factor(1.0)?] })
    }

    /// Number of frames of the episode.
    fn frames(&self) -> usize {
        self.over_time[0].l_dirty().nrows()
    }

    /// Factor over time of a quantity, after the keypoints were turned to modes.
    fn of(&self, quantity: usize) -> &Cholesky<f64, Dyn> {
        let mode = if self.is_seen { (quantity / AXES).min(POINTS) } else { POINTS };
        &self.over_time[mode]
    }

    /// Multiplies the keypoints of each frame and axis by `matrix`. Rows are ordered by frame and within a frame by quantity.
    fn turn(&self, rows: &mut DMatrixViewMut<'_, f64>, matrix: &SMatrix<f64, POINTS, POINTS>) {
        // Without keypoints there is nothing along the object.
        let columns = if self.is_seen { rows.ncols() } else { 0 };
        for (frame, column) in (0..self.frames()).flat_map(|frame| (0..columns).map(move |column| (frame, column))) {
            for axis in 0..AXES {
                let place = |point: usize| (self.quantities * frame + AXES * point + axis, column);
                let turned = matrix * SVector::<f64, POINTS>::from_fn(|point, _| rows[place(point)]);
                (0..POINTS).for_each(|point| rows[place(point)] = turned[point]);
            }
        }
    }

    /// Whitens the rows of an episode, ordered by frame and within a frame by quantity.
    fn whiten(&self, mut rows: DMatrixViewMut<'_, f64>) {
        self.turn(&mut rows, &self.modes.transpose());
        for quantity in 0..self.quantities {
            // Rows of one quantity lie `quantities` apart.
            let mut own =
                DMatrix::from_fn(self.frames(), rows.ncols(), |i, j| rows[(quantity + self.quantities * i, j)]);
            // A Cholesky factor has no zeros on its diagonal, so that the solution exists.
            self.of(quantity).l_dirty().solve_lower_triangular_mut(&mut own);
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
            let is_seen = matches!(channels.first().map(|c| c.quantity), Some(Quantity::Keypoint { .. }));
            Factor::new(&times, (quantities, is_seen), discrepancy)
        };
        Some(Self { episodes: episodes.iter().enumerate().map(factor).collect::<Option<_>>()? })
    }

    /// Log determinant of the covariance, in variances of the noise.
    pub fn log_determinant(&self) -> f64 {
        let of = |f: &Factor| {
            let own = |quantity| f.of(quantity).l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
            2.0 * (0..f.quantities).map(own).sum::<f64>()
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
            let mut rows = DMatrix::zeros(n * factor.quantities, 1);
            for quantity in 0..factor.quantities {
                let values = factor.of(quantity).l() * z.column(quantity);
                (0..n).for_each(|i| rows[(quantity + factor.quantities * i, 0)] = values[i]);
            }
            factor.turn(&mut rows.view_mut((0, 0), (n * factor.quantities, 1)), &factor.modes);
            all.extend(rows.iter());
        }
        DVector::from_vec(all)
    }
}

/// Gain in log likelihood of `more` over `less`, residuals of two models on `episodes` in standard deviations of the noise,
/// nats. Both leave the discrepancy that is likeliest for `less`; none if no covariance is positive definite.
pub fn gain_beside_discrepancy(episodes: &[MeasuredEpisode], less: &DVector<f64>, more: &DVector<f64>) -> Option<f64> {
    let none = Discrepancy { sd: 0.0, time_s: TIMES_S[0] };
    let log = |discrepancy: Discrepancy| {
        let whitening = Whitening::new(episodes, discrepancy)?;
        let mut rows = DMatrix::from_columns(&[less.clone(), more.clone()]);
        whitening.apply(&mut rows);
        let costs = [0, 1].map(|column| rows.column(column).norm_squared());
        Some((-0.5 * (costs[0] + whitening.log_determinant()), 0.5 * (costs[0] - costs[1])))
    };
    let all = Discrepancy::all().into_iter().chain([none]).filter_map(log);
    all.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, gain)| gain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use track_fit::toy::{self, Toy};

    #[test]
    fn errors_along_the_object_have_unit_mean_variance_and_grow_towards_the_tip() {
        let along = along_the_object();
        assert!((along.trace() - 4.0).abs() < 1e-12 && (along - along.transpose()).norm() < 1e-12, "{along}");
        assert!((1..4).all(|i| along[(i, i)] > along[(i - 1, i - 1)]), "{along}");
        // Neighbours move together.
        assert!(along[(2, 3)] / (along[(2, 2)] * along[(3, 3)]).sqrt() > 0.6, "{along}");
    }

    fn episodes() -> Vec<MeasuredEpisode> {
        let episode = toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        vec![episode.clone(), episode]
    }

    fn fit(residuals: DVector<f64>) -> Fit {
        let jacobian = DMatrix::from_fn(residuals.len(), 2, |i, j| ((i + 3 * j) as f64).sin());
        Fit { point: vec![0.5; 2], cost: residuals.norm_squared(), residuals, jacobian, tracks: Vec::new() }
    }

    /// A slow error of all keypoints is no support for a model that happens to lie on its side, although the noise alone would
    /// make the choice certain; without an error the choice counts in full.
    #[test]
    fn a_discrepancy_takes_the_certainty_of_a_choice() {
        let episodes = episodes();
        let rows = 2 * 8 * toy::FRAMES;
        let noise = Whitening::new(&episodes, Discrepancy { sd: 0.0, time_s: 0.4 }).unwrap().draw(&mut seed::rng(5, 0));
        let slow = DVector::from_fn(rows, |i, _| 6.0 * (0.1 * (i / 8) as f64).sin());
        let change = DVector::from_fn(rows, |i, _| (0.1 * (i / 8) as f64).sin());
        let gain = |error: &DVector<f64>| gain_beside_discrepancy(&episodes, error, &(error - &change)).unwrap();
        let certain = 0.5 * ((&slow + &noise).norm_squared() - (&slow + &noise - &change).norm_squared());
        assert!(certain > 100.0 && gain(&(&slow + &noise)) < 0.1 * certain, "{certain} {}", gain(&(&slow + &noise)));
        let expected = 0.5 * (noise.norm_squared() - (&noise - &change).norm_squared());
        assert!((gain(&noise) - expected).abs() < 1e-9 * expected.abs(), "{} {expected}", gain(&noise));
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
            let along = match (a.quantity, b.quantity) {
                (Quantity::Keypoint { point: p, axis: x }, Quantity::Keypoint { point: q, axis: y }) if x == y => {
                    along_the_object()[(p, q)]
                }
                (Quantity::Pose { axis: x }, Quantity::Pose { axis: y }) if x == y => 1.0,
                _ => 0.0,
            };
            along * discrepancy.covariance(a.time_s - b.time_s) + f64::from(u8::from(i == j))
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
