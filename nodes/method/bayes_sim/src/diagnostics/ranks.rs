//! Rank of a measured track among the draws of its posterior predictive distribution.

use catenary_core::statistics::{QuantileMethod, mean, quantile, variance};
use serde::Serialize;

/// Least variance of the draws: a hundredth of a millimetre squared, far below a camera's resolution.
const LEAST_VARIANCE_M2: f64 = 1e-10;
/// Quantiles of the predictive band.
const BAND: [f64; 2] = [0.05, 0.95];
/// Quantiles of the band that holds half of the predictions.
const HALF_BAND: [f64; 2] = [0.25, 0.75];

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

/// Coverage of the predictive bands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bands {
    /// Share of measured coordinates inside of the 25 % to 75 % band of the draws; 0.5 if calibrated.
    pub coverage_50: f64,
    /// Share of the draws and the measurement of which at most as much lies in the 5 % to 95 % band of the others as of the
    /// measurement. Coordinates of a draw depend on each other as those of a measurement do, along the object and in time.
    pub coverage_p_value: f64,
    /// Number of independent coordinates whose coverage would scatter as that of the draws does.
    pub effective_coordinates: f64,
}

/// Ranks of a measured track: sums over all coordinates, first that of the measured track, then those of the draws.
pub(super) struct Ranks {
    /// Squared distances from the mean of the other draws, in their variances.
    distances: Vec<f64>,
    /// Numbers of coordinates inside of the band of the other draws.
    inside: Vec<usize>,
    /// Number of measured coordinates inside of the band that holds half of the draws.
    inside_half: usize,
    /// Number of coordinates.
    count: usize,
}

impl Ranks {
    /// Ranks among `draws` draws, before the first coordinate.
    pub(super) fn new(draws: usize) -> Self {
        Self { distances: vec![0.0; draws + 1], inside: vec![0; draws + 1], inside_half: 0, count: 0 }
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
        self.distances[0] += distance;
        for (distance, v) in self.distances[1..].iter_mut().zip(draws) {
            let value = v - measured;
            *distance += of(value, sum - value, squares - value * value, (n - 1.0).max(1.0));
        }
        let mut order: Vec<usize> = (0..draws.len()).collect();
        order.sort_by(|a, b| draws[*a].total_cmp(&draws[*b]));
        let sorted: Vec<f64> = order.iter().map(|i| draws[*i]).collect();
        let band = |quantiles: [f64; 2]| quantiles.map(|q| quantile(&sorted, q, QuantileMethod::Linear));
        let [low, high] = band(BAND);
        let is_inside = (low..=high).contains(&measured);
        let [low_half, high_half] = band(HALF_BAND);
        self.count += 1;
        self.inside_half += usize::from((low_half..=high_half).contains(&measured));
        self.inside[0] += usize::from(is_inside);
        for (rank, draw) in order.into_iter().enumerate() {
            let [low, high] = BAND.map(|q| quantile_without(&sorted, rank, q));
            self.inside[draw + 1] += usize::from((low..=high).contains(&sorted[rank]));
        }
        Coordinate { error: -sum / n, half_width: 0.5 * (high - low), is_inside, distance }
    }

    /// p value: share of the draws and the measured track that lie at least as far from the mean of the others as the
    /// measured track.
    pub(super) fn p_value(&self) -> f64 {
        let farther = self.distances[1..].iter().filter(|d| **d >= self.distances[0]).count();
        (farther + 1) as f64 / self.distances.len() as f64
    }

    /// Coverage of the bands.
    pub(super) fn bands(&self) -> Bands {
        let coverage: Vec<f64> = self.inside[1..].iter().map(|n| *n as f64 / self.count as f64).collect();
        let emptier = self.inside[1..].iter().filter(|n| **n <= self.inside[0]).count();
        let usual = mean(&coverage);
        let binomial = usual * (1.0 - usual);
        let effective = if binomial > 0.0 { binomial / variance(&coverage) } else { self.count as f64 };
        Bands {
            coverage_50: self.inside_half as f64 / self.count as f64,
            coverage_p_value: (emptier + 1) as f64 / self.inside.len() as f64,
            // Two draws that happen to have equal shares would have no variance.
            effective_coordinates: effective.clamp(1.0, self.count as f64),
        }
    }
}

/// Quantile `q` of `sorted` without the value at `left_out`, by linear interpolation.
fn quantile_without(sorted: &[f64], left_out: usize, q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(2) else { return f64::NAN };
    let at = |i: usize| sorted[i.min(last) + usize::from(i.min(last) >= left_out)];
    let position = q * last as f64;
    let (below, share) = (position.floor() as usize, position.fract());
    at(below) + share * (at(below + 1) - at(below))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    #[test]
    fn a_quantile_without_a_value_is_that_of_the_others() {
        let sorted: Vec<f64> = (0..9).map(|i| f64::from(i * i)).collect();
        for left_out in 0..9 {
            let mut others = sorted.clone();
            others.remove(left_out);
            for q in [0.0, 0.05, 0.3, 0.95, 1.0] {
                let expected = quantile(&others, q, QuantileMethod::Linear);
                assert!((quantile_without(&sorted, left_out, q) - expected).abs() < 1e-12, "{left_out} {q}");
            }
        }
    }

    /// A track of 60 coordinates: a common shift of variance `common`, and noise of its own in each coordinate.
    fn track(common: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let shift: f64 = common.sqrt() * rng.sample::<f64, _>(StandardNormal);
        (0..60).map(|_| shift + (1.0 - common).sqrt() * rng.sample::<f64, _>(StandardNormal)).collect()
    }

    /// Bands of `measured` among 199 tracks.
    fn bands(measured: &[f64], common: f64, rng: &mut ChaCha8Rng) -> Bands {
        let draws: Vec<Vec<f64>> = (0..199).map(|_| track(common, rng)).collect();
        let mut ranks = Ranks::new(199);
        for (i, value) in measured.iter().enumerate() {
            ranks.add(&draws.iter().map(|d| d[i]).collect::<Vec<_>>(), *value);
        }
        ranks.bands()
    }

    /// The p value of the coverage is uniform or larger, whether coordinates depend on each other or not. Of 400 right worlds,
    /// 4 are expected at or below 1 %; more than 12 come with a probability of 0.03 %.
    #[test]
    fn coverage_is_judged_as_that_of_draws_with_the_same_dependence() {
        for (common, least, most) in [(0.0, 45.0, 60.0), (0.9, 1.0, 8.0)] {
            let (mut rare, mut halves) = (0, 0.0);
            for seed in 0..400 {
                let mut rng = seed::rng(seed, 0);
                let measured = track(common, &mut rng);
                let found = bands(&measured, common, &mut rng);
                rare += usize::from(found.coverage_p_value <= 0.01);
                halves += found.coverage_50 / 400.0;
                let effective = found.effective_coordinates;
                assert!((least..=most).contains(&effective), "{common}: {effective}");
            }
            assert!(rare <= 12, "{common}: {rare} of 400");
            // The standard error is 0.003 for independent coordinates, and 0.02 for those that move together.
            assert!((halves - 0.5).abs() < if common == 0.0 { 0.01 } else { 0.06 }, "{common}: {halves}");
        }
    }
}
