//! Rank of a measured track among the draws of its posterior predictive distribution.

use catenary_core::statistics::{QuantileMethod, quantile};

/// Least variance of the draws: a hundredth of a millimetre squared, far below a camera's resolution.
const LEAST_VARIANCE_M2: f64 = 1e-10;
/// Quantiles of the predictive band.
const BAND: [f64; 2] = [0.05, 0.95];

/// Comparison of one coordinate, all in m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coordinate {
    /// Measured value minus mean of the draws.
    pub(super) error: f64,
    /// Half width of the predictive band.
    pub(super) half_width: f64,
    /// True if the measured value lies in the band.
    pub(super) is_inside: bool,
    /// Squared error in variances of the draws.
    pub(super) distance: f64,
}

/// Squared distances from the mean of the other draws, in their variances, summed over all coordinates: first that of the
/// measured track, then those of the draws.
pub(super) struct Ranks(Vec<f64>);

impl Ranks {
    /// Ranks among `draws` draws, before the first coordinate.
    pub(super) fn new(draws: usize) -> Self {
        Self(vec![0.0; draws + 1])
    }

    /// Adds a coordinate: the values of all draws, and the measured value. A draw is compared with the other draws.
    pub(super) fn add(&mut self, draws: &[f64], measured: f64) -> Coordinate {
        // Differences from the measured value: squares of absolute positions would lose digits.
        let (sum, squares) =
            draws.iter().fold((0.0, 0.0), |(s, q), v| (s + (v - measured), q + (v - measured).powi(2)));
        let of = |value: f64, sum: f64, squares: f64, n: f64| {
            let mean = sum / n;
            let variance = (squares / n - mean * mean).max(LEAST_VARIANCE_M2);
            (value - mean).powi(2) / variance
        };
        let n = draws.len() as f64;
        let distance = of(0.0, sum, squares, n);
        self.0[0] += distance;
        for (distance, v) in self.0[1..].iter_mut().zip(draws) {
            let value = v - measured;
            *distance += of(value, sum - value, squares - value * value, (n - 1.0).max(1.0));
        }
        let mut sorted = draws.to_vec();
        sorted.sort_by(f64::total_cmp);
        let [low, high] = BAND.map(|q| quantile(&sorted, q, QuantileMethod::Linear));
        let is_inside = (low..=high).contains(&measured);
        Coordinate { error: -sum / n, half_width: 0.5 * (high - low), is_inside, distance }
    }

    /// p value: share of the draws and the measured track that lie at least as far from the mean of the others as the
    /// measured track.
    pub(super) fn p_value(&self) -> f64 {
        let farther = self.0[1..].iter().filter(|d| **d >= self.0[0]).count();
        (farther + 1) as f64 / self.0.len() as f64
    }
}
