//! Frames that show only a part of the object, or more than it.

use super::KEYPOINTS;
use super::chain::{MOST_LEFT_OUT, Plausible, at, points_m};
use crate::statistics::{QuantileMethod, quantile};
use crate::{Camera, Keypoints};

/// Range of the length through the keypoints, in usual lengths. An object bent to a full circle between the outer keypoints is 0.83 of
/// a straight one; the rest is the noise of the keypoints.
const RANGE: [f64; 2] = [0.75, 1.25];
/// Quantile of the lengths that counts as usual: above the median, because bends and occlusions only shorten.
const USUAL: f64 = 0.75;

/// Leaves out the frames whose keypoints lie on a line of another length than the object's, unless they are too many to be exceptions.
pub(crate) fn of_usual_length(samples: &[(f64, Keypoints)], camera: &Camera, start_ns: i64) -> Plausible<Keypoints> {
    let placed = |(time_s, k): &(f64, Keypoints)| Some((*time_s, points_m(k, camera)?));
    // Keypoints that the camera cannot place were left out before.
    let Some(lines) = samples.iter().map(placed).collect::<Option<Vec<(f64, [[f64; 2]; 4])>>>() else {
        return Plausible { kept: samples.to_vec(), warnings: Vec::new() };
    };
    let (other, warning) = other_lengths(&lines, KEYPOINTS, start_ns);
    let kept = samples.iter().zip(other).filter(|(_, other)| !other).map(|(sample, _)| *sample).collect();
    Plausible { kept, warnings: warning.into_iter().collect() }
}

/// Frames whose keypoints lie on a line of another length than the object's: true for each such frame, and a warning that names them.
/// If they are too many to be exceptions, none is marked, and the warning says so. `points` are in m along the object.
fn other_lengths(frames: &[(f64, [[f64; 2]; 4])], topic: &str, start_ns: i64) -> (Vec<bool>, Option<String>) {
    let length_m = |points: &[[f64; 2]; 4]| -> f64 {
        points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
    };
    let lengths_m: Vec<f64> = frames.iter().map(|(_, points)| length_m(points)).collect();
    let mut sorted = lengths_m.clone();
    sorted.sort_by(f64::total_cmp);
    let none = vec![false; frames.len()];
    let usual_m = quantile(&sorted, USUAL, QuantileMethod::Nearest);
    let is_other = |length_m: f64| length_m < RANGE[0] * usual_m || length_m > RANGE[1] * usual_m;
    let other: Vec<bool> = lengths_m.iter().map(|&length_m| is_other(length_m)).collect();
    let Some(first) = other.iter().position(|&o| o) else { return (none, None) };
    let (count, of) = (other.iter().filter(|&&o| o).count(), frames.len());
    let place = at(frames[first].0, start_ns);
    let lengths = format!("{:.0} mm {place}, and usually {:.0} mm", 1e3 * lengths_m[first], 1e3 * usual_m);
    if count as f64 > MOST_LEFT_OUT * of as f64 {
        let warning = format!(
            "{topic}: in {count} of {of} frames the line through the keypoints has another length ({lengths}): a part of the object is hidden or cut off, or something else is taken for it"
        );
        return (none, Some(warning));
    }
    let warning = format!(
        "{topic}: {count} of {of} frames left out, whose line through the keypoints has another length ({lengths}): a part of the object was hidden, or something else taken for it"
    );
    (other, Some(warning))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of a straight object of 0.3 m, and `count` of another length.
    fn frames(count: usize, share: f64) -> Vec<(f64, [[f64; 2]; 4])> {
        let line = |length: f64| [0.0, 1.0, 2.0, 3.0].map(|k| [0.4, 0.4 - k / 3.0 * length]);
        (0..20).map(|i| (0.05 * i as f64, line(if i < count { 0.3 * share } else { 0.3 }))).collect()
    }

    #[test]
    fn a_short_or_long_frame_is_left_out_and_a_bent_one_is_not() {
        for (share, is_out) in [(0.5, true), (0.85, false), (1.1, false), (1.6, true)] {
            let (other, warning) = other_lengths(&frames(2, share), "/t", 0);
            assert_eq!((other[0], other[1], other[2]), (is_out, is_out, false), "{share}");
            assert_eq!(warning.is_some_and(|w| w.contains("2 of 20 frames left out")), is_out);
        }
        assert_eq!(other_lengths(&[], "/t", 0), (vec![], None));
    }

    #[test]
    fn with_too_many_none_is_left_out_and_the_warning_says_so() {
        let (other, warning) = other_lengths(&frames(6, 0.5), "/t", 0);
        assert!(!other.contains(&true));
        assert!(warning.unwrap().starts_with("/t: in 6 of 20 frames the line"));
    }
}
