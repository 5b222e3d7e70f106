//! Mass of a Gaussian inside of the prior's support.
//!
//! A posterior is a mixture truncated to the prior's support. The mass of a Gaussian inside has a closed form if the edges of
//! one axis cut it. Otherwise it is computed by the separation of variables of Genz (1992, "Numerical computation of
//! multivariate normal probabilities") at the points of a lattice.

use libm::erfc;
use statrs::function::erf::erfc_inv;
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// Distance of an edge from the mean, in standard deviations. An edge at this distance or farther is neglected. The neglected
/// mass is at most 3e-5 per edge.
const FAR: f64 = 4.0;

/// Lower bound of the mass inside whose logarithm [`Support::log_mass`] returns. Truncation would otherwise amplify a Gaussian
/// far outside without bound.
pub const LEAST_INSIDE: f64 = 0.05;

/// Prior's support in the whitened coordinates of a network: a box.
#[derive(Debug, Clone, PartialEq)]
pub struct Support {
    /// Lower edges, D.
    pub low: Vec<f64>,
    /// Upper edges, D.
    pub high: Vec<f64>,
}

/// Points of the unit cube that fill it evenly: a Kronecker lattice. Point i is the first point plus i steps modulo 1. The
/// steps along the D axes are the inverse powers of the root above one of `x^(D + 1) = x + 1` (Roberts 2018).
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// Coordinates of the points, one point after the other.
    points: Vec<f64>,
    dimension: usize,
}

impl Lattice {
    /// Lattice of `points` points. In three dimensions, 32 points give the logarithm of a mass to 0.05.
    pub fn new(points: usize, dimension: usize) -> Self {
        // The root by fixed-point iteration.
        let base = (0..32).fold(2.0, |x: f64, _| (1.0 + x).powf(1.0 / (dimension as f64 + 1.0)));
        let steps: Vec<f64> = (0..dimension).map(|axis| base.powi(-(axis as i32) - 1)).collect();
        let first = 0.5 / points as f64;
        let at = |i: usize| (first + (i / dimension) as f64 * steps[i % dimension]).fract();
        Self { points: (0..points * dimension).map(at).collect(), dimension }
    }
}

/// Standard normal distribution truncated to an interval.
pub(super) struct Between {
    low: f64,
    high: f64,
    /// Mass inside of the interval.
    mass: f64,
    /// Mass above `high` if `low` is positive, else the mass below `low`. The mass of an interval on one side of the mean is
    /// then a difference of small tails, which is precise.
    tail: f64,
}

impl Between {
    /// Distribution between `low` and `high`.
    pub(super) fn new(low: f64, high: f64) -> Self {
        let above = |z: f64| 0.5 * erfc(z * FRAC_1_SQRT_2);
        let (near, far) = if low > 0.0 { (low, high) } else { (-high, -low) };
        let tail = above(far);
        Self { low, high, mass: above(near) - tail, tail }
    }

    /// Mass inside of the interval.
    pub(super) fn mass(&self) -> f64 {
        self.mass
    }

    /// Point below which `share` of the mass lies.
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
    /// Logarithm of the mass that a Gaussian has inside the support, at least that of [`LEAST_INSIDE`]. The Gaussian has `mean`
    /// (D) and covariance `root root^T`. `root` is lower triangular (D x D, row-major). The mass is exact if the edges of at most
    /// one axis cut the Gaussian, and computed with `lattice` otherwise.
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

    /// Mass inside by separation of variables.
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

    /// Mass inside by counting draws.
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
        // Lower triangular roots with strong correlations. The edges of the boxes cut the Gaussian on one axis, at a corner,
        // or on all sides.
        let cases = [
            (support(&[-1.0], &[1.5]), vec![0.8], vec![0.9]),
            (support(&[-1.0, -5.0], &[1.0, 5.0]), vec![0.9, 0.0], vec![0.5, 0.0, 0.6, 0.2]),
            (support(&[-1.0, -1.0], &[1.0, 1.0]), vec![-1.1, 1.2], vec![0.5, 0.0, -0.45, 0.1]),
            (support(&[-1.0; 3], &[1.0; 3]), vec![0.2, -0.5, 0.9], vec![1.5, 0.0, 0.0, 0.8, 0.7, 0.0, -0.2, 0.3, 0.9]),
        ];
        for (case, (support, mean, root)) in cases.into_iter().enumerate() {
            let share = counted(&support, &mean, &root).ln();
            // The standard error of the count is below 0.005.
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
    fn an_uncut_gaussian_has_mass_one_and_a_distant_one_the_least_mass() {
        let support = Support { low: vec![-1.0; 2], high: vec![1.0; 2] };
        let lattice = Lattice::new(8, 2);
        assert_eq!(support.log_mass(&[0.0, 0.5], &[0.2, 0.0, 0.05, 0.1], &lattice), 0.0);
        for far in [3.0, 30.0, 1e6, -1e6] {
            assert_eq!(support.log_mass(&[far, 0.0], &[0.5, 0.0, 0.0, 0.5], &lattice), LEAST_INSIDE.ln(), "{far}");
        }
    }
}
