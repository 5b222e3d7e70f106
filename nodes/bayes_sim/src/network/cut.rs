//! What the edges of the prior leave of a Gaussian.
//!
//! A posterior is a mixture truncated to the prior's support. The mass of a Gaussian inside has a closed form where the edges of
//! one axis cut it; else it comes from the separation of variables of Genz (1992, "Numerical computation of multivariate normal
//! probabilities"), at the points of a lattice.

use libm::erfc;
use statrs::function::erf::erfc_inv;
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// Standard deviations from the mean to an edge from which on the edge cuts nothing off.
const FAR: f64 = 4.0;

/// A Gaussian counts as having this share of its mass inside at least, so that none is made much of for lying far outside.
pub const LEAST_INSIDE: f64 = 0.05;

/// The box that the prior's support is in the coordinates of a network.
#[derive(Debug, Clone, PartialEq)]
pub struct Support {
    /// D lower edges.
    pub low: Vec<f64>,
    /// D upper edges.
    pub high: Vec<f64>,
}

/// Points of the unit cube. Point i is i steps from the first, as the axes count them modulo 1 (Kronecker's lattice); the steps
/// are the inverse powers of the root over one of `x^(D + 1) = x + 1`, which fill a cube of D dimensions evenly.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// One after the other.
    points: Vec<f64>,
    dimension: usize,
}

impl Lattice {
    /// `points` points of D coordinates: 32 are good for the logarithm of a mass to 0.05 in three dimensions.
    pub fn new(points: usize, dimension: usize) -> Self {
        let base = (0..32).fold(2.0, |x: f64, _| (1.0 + x).powf(1.0 / (dimension as f64 + 1.0)));
        let steps: Vec<f64> = (0..dimension).map(|axis| base.powi(-(axis as i32) - 1)).collect();
        let first = 0.5 / points as f64;
        let at = |i: usize| (first + (i / dimension) as f64 * steps[i % dimension]).fract();
        Self { points: (0..points * dimension).map(at).collect(), dimension }
    }
}

/// The standard normal distribution between two places.
struct Between {
    low: f64,
    high: f64,
    /// Its mass there.
    mass: f64,
    /// Its mass in the tail beyond, on the side where that is the smaller one, so that both are precise.
    tail: f64,
}

impl Between {
    fn new(low: f64, high: f64) -> Self {
        let above = |z: f64| 0.5 * erfc(z * FRAC_1_SQRT_2);
        let (near, far) = if low > 0.0 { (low, high) } else { (-high, -low) };
        let tail = above(far);
        Self { low, high, mass: above(near) - tail, tail }
    }

    /// The place below which `share` of the mass lies.
    fn quantile(&self, share: f64) -> f64 {
        let z = if self.low > 0.0 {
            SQRT_2 * erfc_inv(2.0 * (self.tail + (1.0 - share) * self.mass))
        } else {
            -SQRT_2 * erfc_inv(2.0 * (self.tail + share * self.mass))
        };
        z.max(self.low).min(self.high)
    }
}

impl Support {
    /// Logarithm of the mass inside of the Gaussian of `mean` (D) whose covariance is `root root^T`, `root` (D x D, row-major)
    /// lower triangular; at least that of [`LEAST_INSIDE`]. Exact where the edges of one axis at most cut it; else by `lattice`.
    pub fn log_mass(&self, mean: &[f64], root: &[f64], lattice: &Lattice) -> f64 {
        let d = mean.len();
        let sd = |i: usize| root[i * d..][..d].iter().map(|v| v * v).sum::<f64>().sqrt();
        let edges = |i: usize| [self.low[i], self.high[i]].map(|edge| (edge - mean[i]) / sd(i));
        let is_cut = |&i: &usize| edges(i)[0] > -FAR || edges(i)[1] < FAR;
        let mut cut = (0..d).filter(is_cut);
        let mass = match (cut.next(), cut.next()) {
            (None, _) => return 0.0,
            (Some(axis), None) => {
                let [low, high] = edges(axis);
                Between::new(low, high).mass
            }
            _ => self.mass_by_lattice(mean, root, lattice),
        };
        mass.max(LEAST_INSIDE).ln()
    }

    /// Mass inside from the separation of variables.
    fn mass_by_lattice(&self, mean: &[f64], root: &[f64], lattice: &Lattice) -> f64 {
        let d = lattice.dimension;
        let mut z = vec![0.0; d];
        let mut total = 0.0;
        for point in lattice.points.chunks_exact(d) {
            let mut mass = 1.0;
            for (axis, row) in root.chunks_exact(d).enumerate() {
                let known: f64 = row[..axis].iter().zip(&z).map(|(r, z)| r * z).sum();
                let edge = |at: f64| (at - mean[axis] - known) / row[axis];
                let between = Between::new(edge(self.low[axis]), edge(self.high[axis]));
                mass *= between.mass;
                z[axis] = between.quantile(point[axis]);
            }
            total += mass;
        }
        total * d as f64 / lattice.points.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use rand::RngExt;

    /// Mass inside by counting draws of the Gaussian itself.
    fn counted(support: &Support, mean: &[f64], root: &[f64]) -> f64 {
        const DRAWS: usize = 400_000;
        let d = mean.len();
        let mut rng = seed::rng(71, 0);
        let mut is_inside = || {
            let z: Vec<f64> = (0..d).map(|_| rng.sample(rand_distr::StandardNormal)).collect();
            let at = |i: usize| mean[i] + root[i * d..][..d].iter().zip(&z).map(|(r, z)| r * z).sum::<f64>();
            (0..d).all(|i| (support.low[i]..=support.high[i]).contains(&at(i)))
        };
        (0..DRAWS).filter(|_| is_inside()).count() as f64 / DRAWS as f64
    }

    #[test]
    fn masses_are_those_of_counted_draws() {
        let support = |low: &[f64], high: &[f64]| Support { low: low.to_vec(), high: high.to_vec() };
        // Lower triangular roots with strong correlations, and boxes that cut one edge, a corner, or all around.
        let cases = [
            (support(&[-1.0], &[1.5]), vec![0.8], vec![0.9]),
            (support(&[-1.0, -5.0], &[1.0, 5.0]), vec![0.9, 0.0], vec![0.5, 0.0, 0.6, 0.2]),
            (support(&[-1.0, -1.0], &[1.0, 1.0]), vec![-1.1, 1.2], vec![0.5, 0.0, -0.45, 0.1]),
            (support(&[-1.0; 3], &[1.0; 3]), vec![0.2, -0.5, 0.9], vec![1.5, 0.0, 0.0, 0.8, 0.7, 0.0, -0.2, 0.3, 0.9]),
        ];
        for (case, (support, mean, root)) in cases.into_iter().enumerate() {
            let share = counted(&support, &mean, &root).ln();
            // Counts: standard errors under 0.005.
            for (points, bound) in [(4_096, 0.02), (32, 0.05)] {
                let off = support.log_mass(&mean, &root, &Lattice::new(points, mean.len())) - share;
                assert!(off.abs() < bound, "case {case}: off by {off} with {points} points");
            }
        }
    }

    #[test]
    fn one_dimension_is_exact() {
        let half = Support { low: vec![0.0], high: vec![100.0] };
        assert!((half.log_mass(&[0.0], &[1.0], &Lattice::new(1, 1)) - 0.5_f64.ln()).abs() < 1e-12);
    }

    #[test]
    fn what_nothing_cuts_is_whole_and_what_is_nearly_gone_counts_as_the_least() {
        let support = Support { low: vec![-1.0; 2], high: vec![1.0; 2] };
        let lattice = Lattice::new(8, 2);
        assert_eq!(support.log_mass(&[0.0, 0.5], &[0.2, 0.0, 0.05, 0.1], &lattice), 0.0);
        for far in [3.0, 30.0, 1e6, -1e6] {
            assert_eq!(support.log_mass(&[far, 0.0], &[0.5, 0.0, 0.0, 0.5], &lattice), LEAST_INSIDE.ln(), "{far}");
        }
    }
}
