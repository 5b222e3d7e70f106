//! Frame rate of a stream: times in another unit than seconds.

use crate::Model;
use crate::statistics::median_high;

/// Factor on the model's frame interval above which times are implausible, and below which their inverse is. A stream in
/// milliseconds is a thousand times too slow. A camera of 30 Hz that is 25 times slower shows a frame each 0.8 s, about one
/// in a swing; motion capture at 1 kHz is 33 times faster, so that the other bound is farther off.
const TOO_SLOW: f64 = 25.0;
const TOO_FAST: f64 = 100.0;
/// Interval in s above which a stream is implausible for a slow camera, too: frame numbers are 1 apart.
const SLOW_S: f64 = 0.9;
/// Number of the model's frame periods, and of its camera's intervals, between two frames above which a slow stream is
/// implausible: four of five frames are then missing.
const PERIODS: f64 = 5.0;
/// Units smaller than a second, and their number in a second.
const UNITS: [(&str, f64); 3] = [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)];

/// Median interval in s of increasing times, and the one that the model expects; none for fewer than two times.
fn intervals_s(times_s: &[f64], model: &Model) -> Option<[f64; 2]> {
    let usual_s = median_high(&mut times_s.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>())?;
    Some([usual_s, 1.0 / model.camera.rate_hz])
}

/// Doubt as text: expected and received interval, and the repair.
fn doubt([usual_s, expected_s]: [f64; 2], model: &Model, repair: &str) -> String {
    format!(
        "expected times in s, about {expected_s:.3} s apart (camera.rate_hz {} of the model), got {usual_s:.3e} s (the median), as if {repair}, or correct camera.rate_hz",
        model.camera.rate_hz
    )
}

/// Likely unit of times whose intervals are too long, and the repair.
fn slow_unit([usual_s, expected_s]: [f64; 2]) -> String {
    // A camera of 1 kHz has frames 1 ms apart; a camera of such a rate is rarer than a column of frame numbers.
    if (usual_s - 1.0).abs() < 1e-9 && expected_s > 2e-3 {
        return format!("frame numbers: multiply them by the interval, {expected_s:.3} s");
    }
    let off = |(_, number): &(&str, f64)| (usual_s / expected_s / number).ln().abs();
    let nearest = UNITS.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(UNITS[0]);
    format!("in {}: divide the times by {}", nearest.0, nearest.1)
}

/// Doubt about the unit of times in s whose intervals are far too long for the model. None if they fit.
pub(super) fn slow_doubt(times_s: &[f64], model: &Model) -> Option<String> {
    let [usual_s, expected_s] = intervals_s(times_s, model)?;
    let least_s = PERIODS * expected_s.max(model.observation.frame_period_s);
    let is_slow = usual_s > (TOO_SLOW * expected_s).min(SLOW_S).max(least_s);
    is_slow.then(|| doubt([usual_s, expected_s], model, &slow_unit([usual_s, expected_s])))
}

/// Doubt about the unit of the camera's times in s, whose intervals are far too long or too short for the model: expected
/// and received interval, and the likely unit. None if they fit, or there are fewer than two times.
pub fn interval_doubt(times_s: &[f64], model: &Model) -> Option<String> {
    let fast = || {
        let [usual_s, expected_s] = intervals_s(times_s, model)?;
        let is_fast = usual_s * TOO_FAST < expected_s;
        is_fast.then(|| doubt([usual_s, expected_s], model, "in seconds divided by 1000: multiply the times by 1000"))
    };
    slow_doubt(times_s, model).or_else(fast)
}
