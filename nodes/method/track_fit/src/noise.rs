//! Noise of the keypoints, estimated from a recording itself.
//!
//! Objects move smoothly, and a detector errs anew in each frame. Differences of high order of successive frames cancel
//! the motion and keep white noise: the mean square of such a difference, with weights of unit norm, has at least the variance
//! of the noise as its expectation. Motion that is fast for the frame rate only adds to it. It is therefore an upper bound.
//!
//! A lower bound needs white noise, of which the differences of every second frame have the same power. Noise that is
//! correlated in time (a tracker that smooths, an offset that wanders) has up to twice the power there, and so has
//! motion. [`NoiseEstimate::is_white`] compares both. Two more traps: repeated frames are no observations, and rounded
//! coordinates show the rounding alone.

mod contrast;
mod judgement;
mod series;

pub use judgement::KeypointNoise;
pub use series::Series;

use catenary_core::statistics::Z_95;
use contrast::{Powers, powers};

/// Greatest order of the differences. The sixth leaves 1 / 500 of a swing of a tenth of the frame rate.
const MOST_ORDER: usize = 6;
/// Ratio of the power at every second frame to that at each frame between whose limits noise counts as white: 1 for white
/// noise, 2 for noise with a long correlation, 0 for a wave of half the frame rate.
const WHITE: [f64; 2] = [0.5, 1.5];
/// Standard normal quantile of a one-sided limit of 95 %.
const ONE_SIDED: f64 = 1.645;
/// Standard deviation in steps of rounded coordinates below which it tells of the rounding alone. Rounding by itself has
/// 0.29 steps.
const ROUNDING: f64 = 0.5;
/// Share of independent coordinates below which the keypoints move together. Motion has two or three shapes, of eight coordinates.
const INDEPENDENT: f64 = 0.5;

/// Standard deviation of the white noise of a coordinate, estimated from high-order differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseEstimate {
    /// Estimated standard deviation, in the unit of the coordinates.
    pub sd: f64,
    /// Effective number of independent squares behind it.
    pub effective: f64,
    /// Order of the differences.
    pub order: usize,
    /// Power at every second frame, relative to that at each frame.
    pub ratio: f64,
    /// Standard deviation of the ratio around 1, if the noise is white.
    pub ratio_sd: f64,
    /// Share of the coordinates that err independently: 1 for a detector of single points, 0.25 for a curve with two
    /// coefficients.
    pub independent: f64,
    /// True if differences of every higher order look like white noise, too.
    pub is_steady: bool,
    /// True if the coordinates are rounded so coarsely that the rounding alone is seen.
    pub is_rounded: bool,
}

impl NoiseEstimate {
    /// Returns whether the differences are those of white noise, by more than chance.
    pub fn is_white(&self) -> bool {
        // The ratio scatters in proportion to itself.
        let margin = ONE_SIDED * self.ratio_sd;
        let [low, high] = [1.0 - margin, 1.0 + margin].map(|by| by * self.ratio);
        !self.is_rounded && low > WHITE[0] && high < WHITE[1]
    }

    /// Returns whether the coordinates err independently, as motion does not.
    pub fn is_independent(&self) -> bool {
        self.independent >= INDEPENDENT
    }

    /// Upper end of the interval of the standard deviation at the standard normal quantile `z`.
    pub fn high(&self, z: f64) -> f64 {
        self.sd / chi_square_share(self.effective, -z).sqrt()
    }

    /// Lower end of the interval of the standard deviation at the standard normal quantile `z`: 0 unless the noise is white.
    pub fn low(&self, z: f64) -> f64 {
        if self.is_white() { self.sd / chi_square_share(self.effective, z).sqrt() } else { 0.0 }
    }
}

/// Quantile of a chi-square variable of `n` degrees of freedom over n (Wilson and Hilferty 1931).
fn chi_square_share(n: f64, z: f64) -> f64 {
    let spread = 2.0 / (9.0 * n);
    // A few degrees of freedom bound nothing from above: the approximation falls below zero there.
    (1.0 - spread + z * spread.sqrt()).max(1e-2).powi(3)
}

/// Noise of a coordinate of `series`, pooled over all of them. `absorbed` is the share of the squares that a fit has taken out
/// of the series; 0 for recordings themselves. None for series without three frames that differ.
///
/// The order is the one with the least upper bound, among those whose differences are white if there is one.
pub fn noise_of(series: &[Series], absorbed: f64) -> Option<NoiseEstimate> {
    let all: Vec<NoiseEstimate> =
        (1..=MOST_ORDER).filter_map(|order| estimate(series, order, absorbed.clamp(0.0, 0.9))).collect();
    let least =
        |of: &mut dyn Iterator<Item = &NoiseEstimate>| of.min_by(|a, b| a.high(Z_95).total_cmp(&b.high(Z_95))).copied();
    let found = least(&mut all.iter().filter(|e| e.is_white())).or_else(|| least(&mut all.iter()))?;
    let is_steady = all.iter().all(|e| e.order < found.order || (WHITE[0]..WHITE[1]).contains(&e.ratio));
    Some(NoiseEstimate { is_steady, ..found })
}

/// Estimate by differences of one order; none if no difference is left.
fn estimate(series: &[Series], order: usize, absorbed: f64) -> Option<NoiseEstimate> {
    let Powers { each, second, squares, independent } = powers(series, order)?;
    if !(each > 0.0 && each.is_finite() && second.is_finite()) {
        return None;
    }
    let sd = (each / (1.0 - absorbed)).sqrt();
    let [of_each, of_second, of_both] = squares.map(|s| 2.0 * s / independent);
    let effective = 2.0 / of_each;
    // To first order, the variance of a quotient of two means of 1.
    let ratio_sd = (of_each + of_second - 2.0 * of_both).max(0.0).sqrt();
    let steps = series.iter().filter_map(Series::step).fold(f64::INFINITY, f64::min);
    let mut found = NoiseEstimate {
        sd,
        effective,
        order,
        ratio: second / each,
        ratio_sd,
        independent,
        is_steady: false,
        is_rounded: false,
    };
    found.is_rounded = steps.is_finite() && found.sd < ROUNDING * steps;
    Some(found)
}

#[cfg(test)]
mod tests;
