//! Residual energy of a fit in excess of noise.

use super::problem::Fit;
use crate::data::{Channel, Quantity};

/// Mean squared residual, in variances of the noise, above which a fit leaves a large gap.
const MUCH: f64 = 3.0;
/// Excess residual energy, in standard deviations of noise, above which the search for the best fit goes on.
const USUAL_SDS: f64 = 1.0;

/// Returns whether a fit leaves more than usual noise. The threshold is low, because a soft object on a table may be
/// mistaken for another one with the same visible end, at a slightly higher cost.
pub fn leaves_more_than_noise(fit: &Fit) -> bool {
    is_beyond_noise(fit, USUAL_SDS)
}

/// Returns whether the residual energy exceeds the number of coordinates by more than `sds` standard deviations of
/// noise.
pub fn is_beyond_noise(fit: &Fit, sds: f64) -> bool {
    let coordinates = fit.residuals.len() as f64;
    fit.cost > coordinates + sds * (2.0 * coordinates).sqrt()
}

/// Returns whether a fit leaves a large gap.
pub fn leaves_much(fit: &Fit) -> bool {
    fit.cost > MUCH * fit.residuals.len() as f64
}

/// Standard deviations of the residual energy beyond which the stated noise is overruled: one right model in a thousand.
const OVERRULED_SDS: f64 = 3.0;

/// Variance of the residuals in variances of the stated noise, if it exceeds that by more than chance allows; else 1.
///
/// A posterior whose likelihood keeps the stated noise would be falsely certain where the model leaves more than that
/// (Birge 1932).
pub fn noise_inflation(fit: &Fit) -> f64 {
    if !is_beyond_noise(fit, OVERRULED_SDS) {
        return 1.0;
    }
    fit.cost / (fit.residuals.len() as f64 - fit.point.len() as f64).max(1.0)
}

/// Variance of the wrench's residuals in variances of its stated noise, if it exceeds that by more than chance allows; else 1. `channels` are
/// the rows of the fit.
///
/// The mean over all rows would hide it: keypoints are several times as many, and their noise is another.
pub fn wrench_inflation(fit: &Fit, channels: &[Channel]) -> f64 {
    let of_wrench = channels.iter().zip(&fit.residuals).filter(|(c, _)| matches!(c.quantity, Quantity::Wrench { .. }));
    let (count, cost) = of_wrench.fold((0.0_f64, 0.0_f64), |(count, cost), (_, r)| (count + 1.0, cost + r * r));
    if cost > count + OVERRULED_SDS * (2.0 * count).sqrt() { cost / count } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn the_noise_is_inflated_only_beyond_chance() {
        let of = |cost| {
            let (residuals, jacobian) = (DVector::zeros(200), DMatrix::zeros(200, 2));
            noise_inflation(&Fit { point: vec![0.5; 2], cost, residuals, jacobian, tracks: Vec::new() })
        };
        // 20 is one standard deviation of a sum of 200 squares.
        assert_eq!((of(50.0), of(255.0)), (1.0, 1.0));
        assert!((of(396.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_noise_of_a_wrench_is_judged_by_its_own_rows() {
        let row = |frame: usize, quantity| Channel { episode: 0, frame, time_s: 0.1 * frame as f64, quantity };
        let both =
            |frame| [row(frame, Quantity::Keypoint { point: 0, axis: 0 }), row(frame, Quantity::Wrench { axis: 1 })];
        let channels: Vec<Channel> = (0..100).flat_map(both).collect();
        let of = |keypoint: f64, wrench: f64| {
            let residuals = DVector::from_fn(200, |i, _| if i % 2 == 0 { keypoint } else { wrench });
            let cost = residuals.norm_squared();
            let jacobian = DMatrix::zeros(200, 2);
            wrench_inflation(&Fit { point: vec![0.5; 2], cost, residuals, jacobian, tracks: Vec::new() }, &channels)
        };
        assert!((of(0.1, 1.5) - 2.25).abs() < 1e-12 && of(3.0, 1.1) == 1.0, "{} {}", of(0.1, 1.5), of(3.0, 1.1));
    }
}
