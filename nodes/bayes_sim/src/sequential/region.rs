//! The region of highest density of a mixture, inside the unit cube, and uniform draws from it.

use catenary_core::Mixture;
use catenary_core::mixture::{MixtureError, in_unit_cube};
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Mixture draws that set the threshold.
const THRESHOLD_DRAWS: usize = 4_000;
/// Draws behind a volume.
const VOLUME_DRAWS: usize = 8_000;
/// Draws that one point of the region may take.
pub const MOST_DRAWS: usize = 1_000_000;

/// The points of the unit cube where a mixture's density is at least a threshold.
#[derive(Debug, Clone)]
pub struct Region {
    mixture: Mixture,
    log_threshold: f64,
    cover: Vec<Ellipsoid>,
    volume: f64,
}

/// An ellipsoid `centre + root * (unit ball)`.
#[derive(Debug, Clone)]
struct Ellipsoid {
    centre: DVector<f64>,
    /// Lower triangular.
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
        let radius = rng.random::<f64>().powf(1.0 / d as f64) / direction.norm();
        (&self.centre + &self.root * direction * radius).as_slice().to_vec()
    }
}

/// Volume of the unit ball of `d` dimensions.
fn ball_volume(d: usize) -> f64 {
    match d {
        0 => 1.0,
        1 => 2.0,
        _ => ball_volume(d - 2) * std::f64::consts::TAU / d as f64,
    }
}

impl Region {
    /// The region that leaves out `tail` of the mass of `mixture` truncated to the unit cube, made larger, where it must
    /// be, until its volume is at least `least_volume`.
    pub fn new<R: Rng>(mixture: &Mixture, tail: f64, least_volume: f64, rng: &mut R) -> Result<Self, MixtureError> {
        let mut densities = (0..THRESHOLD_DRAWS)
            .map(|_| Ok(mixture.log_density(&mixture.sample_truncated(rng)?)))
            .collect::<Result<Vec<f64>, MixtureError>>()?;
        densities.sort_by(f64::total_cmp);
        let mut log_threshold = densities[(tail * (THRESHOLD_DRAWS - 1) as f64) as usize];
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

    /// Volume, at most 1; by seeded Monte Carlo, to about 1 %.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Whether `u` lies in the region.
    pub fn contains(&self, u: &[f64]) -> bool {
        in_unit_cube(u) && self.mixture.log_density(u) >= self.log_threshold
    }

    /// One draw from the union of the cover, uniform where it lies in the region: an ellipsoid by volume, a point of it,
    /// kept with the inverse of the number of ellipsoids that hold it.
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

    /// One point, uniform in the region; none where the region is too thin to be hit.
    pub fn sample<R: Rng>(&self, rng: &mut R) -> Option<Vec<f64>> {
        (0..MOST_DRAWS).find_map(|_| self.draw(rng))
    }

    fn measured_volume<R: Rng>(&self, rng: &mut R) -> f64 {
        let total: f64 = self.cover.iter().map(|e| e.volume).sum();
        let hits = (0..VOLUME_DRAWS).filter(|_| self.draw(rng).is_some()).count();
        (total * hits.max(1) as f64 / VOLUME_DRAWS as f64).min(1.0)
    }
}

/// Ellipsoids whose union holds the region: where `sum_k w_k N_k(u) >= t`, some `w_k N_k(u) >= t / K`.
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
