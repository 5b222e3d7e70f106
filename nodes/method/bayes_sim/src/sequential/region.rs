//! Highest-density region of a mixture inside of the unit cube, with uniform draws from it.

use catenary_core::Mixture;
use catenary_core::mixture::{MixtureError, in_unit_cube};
use catenary_core::statistics::{QuantileMethod, quantile};
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Number of mixture draws that determine the threshold. With a tail of 5e-4, ten of them lie beyond it.
const THRESHOLD_DRAWS: usize = 20_000;
/// Number of draws for a volume.
const VOLUME_DRAWS: usize = 8_000;
/// Largest number of draws for one point of the region.
pub const MOST_DRAWS: usize = 1_000_000;

/// Points of the unit cube at which a mixture's density is at least a threshold.
#[derive(Debug, Clone)]
pub struct Region {
    mixture: Mixture,
    log_threshold: f64,
    /// Ellipsoids whose union contains the region.
    cover: Vec<Ellipsoid>,
    volume: f64,
}

/// Ellipsoid `centre + root * (unit ball)`.
#[derive(Debug, Clone)]
struct Ellipsoid {
    centre: DVector<f64>,
    /// Lower triangular root of the shape matrix.
    root: DMatrix<f64>,
    volume: f64,
}

impl Ellipsoid {
    fn contains(&self, u: &[f64]) -> bool {
        let mut v = DVector::from_column_slice(u) - &self.centre;
        self.root.solve_lower_triangular_mut(&mut v) && v.norm_squared() <= 1.0
    }

    fn sample<R: Rng>(&self, rng: &mut R) -> Vec<f64> {
        let d = self.centre.len();
        let direction = DVector::from_fn(d, |_, _| rng.sample::<f64, _>(StandardNormal));
        // The volume within a radius grows with its d-th power.
        let radius = rng.random::<f64>().powf(1.0 / d as f64) / direction.norm();
        (&self.centre + &self.root * direction * radius).as_slice().to_vec()
    }
}

/// Volume of the unit ball in `d` dimensions.
fn ball_volume(d: usize) -> f64 {
    match d {
        0 => 1.0,
        1 => 2.0,
        _ => ball_volume(d - 2) * std::f64::consts::TAU / d as f64,
    }
}

impl Region {
    /// Region that leaves out `tail` of the mass of `mixture` truncated to the unit cube. The threshold falls until the volume
    /// is at least `least_volume`.
    ///
    /// # Errors
    /// [`MixtureError::OutsideSupport`] if the mixture has no mass inside of the unit cube.
    pub fn new<R: Rng>(mixture: &Mixture, tail: f64, least_volume: f64, rng: &mut R) -> Result<Self, MixtureError> {
        let mut densities = (0..THRESHOLD_DRAWS)
            .map(|_| Ok(mixture.log_density(&mixture.sample_truncated(rng)?)))
            .collect::<Result<Vec<f64>, MixtureError>>()?;
        densities.sort_by(f64::total_cmp);
        let mut log_threshold = quantile(&densities, tail, QuantileMethod::Lower);
        loop {
            let mut region =
                Self { mixture: mixture.clone(), log_threshold, cover: cover(mixture, log_threshold), volume: 0.0 };
            region.volume = region.measured_volume(rng);
            if region.volume >= least_volume {
                return Ok(region);
            }
            log_threshold -= 1.0;
        }
    }

    /// Volume, at most 1, by seeded Monte Carlo. Its error is 1 % if half of the cover's draws are kept, 3 % if a tenth.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Returns true if `u` lies in the region.
    pub fn contains(&self, u: &[f64]) -> bool {
        in_unit_cube(u) && self.mixture.log_density(u) >= self.log_threshold
    }

    /// Makes one attempt at a uniform draw from the region; none if the attempt is rejected. An ellipsoid is chosen in
    /// proportion to its volume and a point uniformly from it. The point is kept with a probability of one over the number of
    /// ellipsoids that contain it.
    fn draw<R: Rng>(&self, rng: &mut R) -> Option<Vec<f64>> {
        let total: f64 = self.cover.iter().map(|e| e.volume).sum();
        let mut left = rng.random::<f64>() * total;
        let picked = self.cover.iter().find(|e| {
            left -= e.volume;
            left < 0.0
        });
        let u = picked.or(self.cover.last())?.sample(rng);
        let lot: f64 = rng.random();
        if !in_unit_cube(&u) {
            return None;
        }
        let holders = self.cover.iter().filter(|e| e.contains(&u)).count().max(1);
        (lot * (holders as f64) < 1.0 && self.contains(&u)).then_some(u)
    }

    /// Uniform draw from the region; none if the region is too thin to be hit.
    pub fn sample<R: Rng>(&self, rng: &mut R) -> Option<Vec<f64>> {
        (0..MOST_DRAWS).find_map(|_| self.draw(rng))
    }

    /// Volume by the share of accepted attempts.
    fn measured_volume<R: Rng>(&self, rng: &mut R) -> f64 {
        let total: f64 = self.cover.iter().map(|e| e.volume).sum();
        let hits = (0..VOLUME_DRAWS).filter(|_| self.draw(rng).is_some()).count();
        // At least one hit: a volume of zero would make densities infinite.
        (total * hits.max(1) as f64 / VOLUME_DRAWS as f64).min(1.0)
    }
}

/// Ellipsoids whose union contains the region. If `sum_k w_k N_k(u) >= t`, then `w_k N_k(u) >= t / K` for some k.
fn cover(mixture: &Mixture, log_threshold: f64) -> Vec<Ellipsoid> {
    let d = mixture.dimension();
    let k = mixture.weights().len();
    let ellipsoid = |(i, weight): (usize, &f64)| {
        let (mean, covariance) = mixture.component(i);
        let root = Cholesky::new(covariance.clone())?.unpack();
        let log_det: f64 = root.diagonal().iter().map(|v| v.ln()).sum();
        let log_norm = -0.5 * d as f64 * std::f64::consts::TAU.ln() - log_det;
        let radius_squared = 2.0 * (weight.ln() + log_norm + (k as f64).ln() - log_threshold);
        let radius = (radius_squared > 0.0).then(|| radius_squared.sqrt())?;
        let volume = ball_volume(d) * (log_det + d as f64 * radius.ln()).exp();
        Some(Ellipsoid { centre: mean.clone(), root: root * radius, volume })
    };
    mixture.weights().iter().enumerate().filter_map(ellipsoid).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;

    fn gaussian(mean: &[f64], variances: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        (DVector::from_row_slice(mean), DMatrix::from_diagonal(&DVector::from_row_slice(variances)))
    }

    fn mixture(weights: &[f64], parts: Vec<(DVector<f64>, DMatrix<f64>)>) -> Mixture {
        let (means, covariances) = parts.into_iter().unzip();
        Mixture::new(weights, means, covariances).unwrap()
    }

    /// Two overlapping components, one of which reaches out of the square.
    fn two() -> Mixture {
        let lean = DMatrix::from_row_slice(2, 2, &[0.02, 0.015, 0.015, 0.02]);
        mixture(&[0.7, 0.3], vec![(DVector::from_row_slice(&[0.8, 0.85]), lean), gaussian(&[0.6, 0.6], &[0.01, 0.005])])
    }

    #[test]
    fn leaves_out_the_stated_mass() {
        for (tail, stream) in [(0.02, 0), (0.2, 1), (5e-4, 2)] {
            let mixture = two();
            let region = Region::new(&mixture, tail, 0.0, &mut seed::rng(51, stream)).unwrap();
            let mut rng = seed::rng(52, stream);
            const DRAWS: usize = 40_000;
            let out = (0..DRAWS).filter(|_| !region.contains(&mixture.sample_truncated(&mut rng).unwrap())).count();
            let share = out as f64 / DRAWS as f64;
            // The threshold is a quantile of THRESHOLD_DRAWS draws; four standard errors: one wrong seed in 15,000.
            let bound = 4.0 * (tail * (1.0 - tail) * (1.0 / THRESHOLD_DRAWS as f64 + 1.0 / DRAWS as f64)).sqrt();
            assert!((share - tail).abs() < bound, "{share} for a tail of {tail}, bound {bound}");
        }
    }

    #[test]
    fn the_volume_is_that_of_the_chosen_points() {
        // One round Gaussian well inside: the region is a ball of chi-square radius, and with two degrees of freedom
        // its square is -2 ln(tail) variances.
        let round = mixture(&[1.0], vec![gaussian(&[0.5, 0.5], &[0.004, 0.004])]);
        let region = Region::new(&round, 0.1, 0.0, &mut seed::rng(53, 0)).unwrap();
        let exact = std::f64::consts::PI * 0.004 * -2.0 * 0.1_f64.ln();
        // The quantile's standard error is sqrt(0.9 / (0.1 * 4,000)) = 4.7 % of a variance's 2 ln units: 2.1 %; four.
        assert!((region.volume() / exact - 1.0).abs() < 0.085, "{} against {exact}", region.volume());
        // Against a fine grid, where components overlap and the square cuts: the cover's draws are right to 4 x 1 %.
        let region = Region::new(&two(), 0.05, 0.0, &mut seed::rng(53, 1)).unwrap();
        let at = |i: usize| (i as f64 + 0.5) / 1000.0;
        let inside = (0..1_000_000).filter(|i| region.contains(&[at(i / 1000), at(i % 1000)])).count() as f64 / 1e6;
        assert!((region.volume() / inside - 1.0).abs() < 0.06, "{} against {inside}", region.volume());
    }

    #[test]
    fn draws_are_uniform_in_the_region() {
        let region = Region::new(&two(), 0.05, 0.0, &mut seed::rng(54, 0)).unwrap();
        let at = |i: usize| (i as f64 + 0.5) / 500.0;
        let points: Vec<[f64; 2]> =
            (0..250_000).map(|i| [at(i / 500), at(i % 500)]).filter(|u| region.contains(u)).collect();
        let mut rng = seed::rng(55, 0);
        const DRAWS: usize = 20_000;
        let draws: Vec<Vec<f64>> = (0..DRAWS).map(|_| region.sample(&mut rng).unwrap()).collect();
        assert!(draws.iter().all(|u| region.contains(u)));
        for axis in 0..2 {
            let mean = |v: &mut dyn Iterator<Item = f64>| {
                let (sum, n) = v.fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
                sum / n
            };
            let exact = mean(&mut points.iter().map(|u| u[axis]));
            let spread = mean(&mut points.iter().map(|u| (u[axis] - exact).powi(2))).sqrt();
            let drawn = mean(&mut draws.iter().map(|u| u[axis]));
            // Four standard errors: one wrong seed in 15,000.
            assert!((drawn - exact).abs() < 4.0 * spread / (DRAWS as f64).sqrt(), "axis {axis}: {drawn}, {exact}");
        }
    }

    #[test]
    fn grows_to_the_least_volume_and_never_beyond_the_cube() {
        let narrow = mixture(&[1.0], vec![gaussian(&[0.5, 0.5], &[1e-4, 1e-4])]);
        let free = Region::new(&narrow, 1e-3, 0.0, &mut seed::rng(56, 0)).unwrap();
        let grown = Region::new(&narrow, 1e-3, 0.25, &mut seed::rng(56, 0)).unwrap();
        assert!(free.volume() < 0.01 && (0.25..0.3).contains(&grown.volume()), "{}, {}", free.volume(), grown.volume());
        let wide = mixture(&[1.0], vec![gaussian(&[0.5, 0.5], &[4.0, 4.0])]);
        let all = Region::new(&wide, 1e-3, 0.0, &mut seed::rng(56, 1)).unwrap();
        assert!((0.9..=1.0).contains(&all.volume()), "{}", all.volume());
        assert!(!all.contains(&[1.01, 0.5]));
        let far = mixture(&[1.0], vec![gaussian(&[9.0, 9.0], &[1e-4, 1e-4])]);
        assert_eq!(Region::new(&far, 1e-3, 0.0, &mut seed::rng(56, 2)).unwrap_err(), MixtureError::OutsideSupport);
    }
}
