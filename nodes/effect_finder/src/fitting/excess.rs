//! Residual energy of a fit in excess of noise.

use super::problem::Fit;

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
