//! Posterior predictive check (Gelman, Meng and Stern 1996): simulated tracks of posterior draws against the measured ones.

use catenary_core::statistics::{QuantileMethod, quantile};
use catenary_core::track::End;
use catenary_core::{Camera, Track};
use serde::{Deserialize, Serialize};

/// Least variance of the draws: a hundredth of a millimetre squared, far below a camera's resolution.
const LEAST_VARIANCE_M2: f64 = 1e-10;
/// Quantiles of the predictive band.
const BAND: [f64; 2] = [0.05, 0.95];

/// Posterior predictive check. Keypoints are compared as sets: the four of each frame in the order nearest to the measured
/// ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Predictive {
    /// Root mean square distance of the mean prediction from the measured keypoints in mm.
    pub rmse_mm: f64,
    /// Share of measured coordinates inside of the 5 % to 95 % band of the draws; 0.9 if calibrated.
    pub coverage: f64,
    /// Root mean square half width of that band in mm.
    pub half_width_mm: f64,
    /// Root mean square distance of the measured keypoints from their own mean in mm: the error of the trivial prediction.
    pub spread_mm: f64,
    /// p value: share of the draws and the measurement that lie at least as far from the mean of the other draws as the
    /// measurement from the mean of all draws. Small means that the model does not produce such tracks.
    pub p_value: f64,
    /// Number of compared draws.
    pub draws: usize,
}

/// Outcome of a posterior predictive check.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictiveCheck {
    /// Figures of the check.
    pub figures: Predictive,
    /// Numbers of compared and of measured frames, over all episodes. Fewer are compared if every draw ended earlier.
    pub frames: [usize; 2],
}

impl PredictiveCheck {
    /// Warning that the check covers a part of the measured frames only; none if it covers all.
    pub fn warning(&self) -> Option<String> {
        let [compared, measured] = self.frames;
        (compared < measured).then(|| {
            format!(
                "the posterior's predictions were compared with the first {compared} of {measured} measured frames only: every simulated draw reached the goal and ended before the last one; set task.success_reward to 2, which nothing reaches, to compare all frames"
            )
        })
    }
}

/// Reason for which posterior draws were not compared with the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unchecked {
    /// No draw could be simulated up to the last measured frame or to the goal.
    NoDraw,
    /// The camera cannot project a keypoint to the plane of motion.
    NotPlaced,
}

impl Unchecked {
    /// Warning about the missing check; none if [`super::misfit`] already explains it.
    pub fn warning(self) -> Option<String> {
        let why = match self {
            Self::NoDraw => return None,
            Self::NotPlaced => "the model's camera cannot project a keypoint to the plane of motion",
        };
        Some(format!("the posterior's predictions were not compared with the measurement: {why}"))
    }
}

/// Number of measured keypoints outside of the camera's view.
pub fn out_of_view(track: &Track) -> usize {
    let inside = |p: &&[f64; 2]| p.iter().all(|v| (-1.0..=1.0).contains(v));
    track.frames.iter().flat_map(|f| &f.dlo).filter(|p| !inside(p)).count()
}

/// Draws that are compared, and the number of frames of each episode that are compared.
struct Selection {
    draws: Vec<usize>,
    frames: Vec<usize>,
}

impl Selection {
    /// Selects the draws that reached every measured frame. If there are none, because a success ends an episode of the task
    /// `reach`, it selects the draws that ended by a success, and the frames up to the earliest end.
    ///
    /// The earliest end depends on the draws and the measurement alike: those of one distribution stay exchangeable, and the
    /// p value stays valid.
    fn new(episodes: &[(&Track, Vec<Track>)]) -> Option<Self> {
        let finite = |t: &Track| t.frames.iter().all(|f| f.dlo.as_flattened().iter().all(|v| v.is_finite()));
        let draws = episodes.iter().map(|(_, tracks)| tracks.len()).min().unwrap_or(0);
        let reaches = |m: &Track, t: &Track| t.frames.len() >= m.frames.len();
        let in_all = |i: usize, check: &dyn Fn(&Track, &Track) -> bool| episodes.iter().all(|(m, t)| check(m, &t[i]));
        let whole: Vec<usize> = (0..draws).filter(|i| in_all(*i, &|m, t| reaches(m, t) && finite(t))).collect();
        if !whole.is_empty() {
            return Some(Self { draws: whole, frames: episodes.iter().map(|(m, _)| m.frames.len()).collect() });
        }
        let succeeded = |m: &Track, t: &Track| finite(t) && (reaches(m, t) || t.end == End::Success);
        let draws: Vec<usize> = (0..draws).filter(|i| in_all(*i, &succeeded)).collect();
        let earliest = |(m, tracks): &(&Track, Vec<Track>)| {
            draws.iter().map(|&i| tracks[i].frames.len()).chain([m.frames.len()]).min().unwrap_or(0)
        };
        let frames: Vec<usize> = episodes.iter().map(earliest).collect();
        (!draws.is_empty()).then_some(Self { draws, frames })
    }
}

/// Compares simulated tracks of posterior draws, noise included, with the measured tracks. `episodes` holds each measured
/// track with the tracks of all draws.
///
/// # Errors
/// [`Unchecked`] if no draw reached the last measured frame or the goal, or the camera cannot project a keypoint.
pub fn predictive(episodes: &[(&Track, Vec<Track>)], camera: &Camera) -> Result<PredictiveCheck, Unchecked> {
    let Selection { draws, frames } = Selection::new(episodes).ok_or(Unchecked::NoDraw)?;
    let place = |p: [f64; 2]| camera.plane_from_scaled(p).ok_or(Unchecked::NotPlaced);
    let (mut squares, mut widths, mut inside, mut count) = (0.0, 0.0, 0usize, 0usize);
    let mut measured_points: Vec<[f64; 2]> = Vec::new();
    let mut distances = vec![0.0; draws.len() + 1];
    for ((measured, tracks), compared) in episodes.iter().zip(&frames) {
        for (i, frame) in measured.frames[..*compared].iter().enumerate() {
            let drawn: Vec<[[f64; 2]; 4]> =
                draws.iter().map(|&t| nearest_order(&frame.dlo, &tracks[t].frames[i].dlo)).collect();
            for k in 0..4 {
                let seen = place(frame.dlo[k])?;
                measured_points.push(seen);
                let points = drawn.iter().map(|d| place(d[k])).collect::<Result<Vec<[f64; 2]>, Unchecked>>()?;
                for axis in 0..2 {
                    let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
                    add_distances(&mut distances, &values, seen[axis]);
                    values.sort_by(f64::total_cmp);
                    let mean = values.iter().sum::<f64>() / values.len() as f64;
                    let [low, high] = BAND.map(|q| quantile(&values, q, QuantileMethod::Linear));
                    squares += (mean - seen[axis]).powi(2);
                    widths += (0.5 * (high - low)).powi(2);
                    inside += usize::from((low..=high).contains(&seen[axis]));
                    count += 1;
                }
            }
        }
    }
    let farther = distances[1..].iter().filter(|d| **d >= distances[0]).count();
    // A keypoint's distance has two coordinates: half as many distances as coordinates.
    let root = |sum: f64, n: f64| 1e3 * (sum / n).sqrt();
    if count == 0 {
        return Err(Unchecked::NoDraw);
    }
    let figures = Predictive {
        rmse_mm: root(squares, 0.5 * count as f64),
        coverage: inside as f64 / count as f64,
        half_width_mm: root(widths, count as f64),
        spread_mm: root(spread(&measured_points), 0.5 * count as f64),
        p_value: (farther + 1) as f64 / distances.len() as f64,
        draws: draws.len(),
    };
    let measured = episodes.iter().map(|(m, _)| m.frames.len()).sum();
    Ok(PredictiveCheck { figures, frames: [frames.iter().sum(), measured] })
}

/// Adds the squared distances from the mean of the draws, in their standard deviations, to `distances`: first that of the
/// measured value, then those of the draws. A draw is compared with the other draws.
fn add_distances(distances: &mut [f64], draws: &[f64], measured: f64) {
    // Differences from the measured value: squares of absolute positions would lose digits.
    let (sum, squares) = draws.iter().fold((0.0, 0.0), |(s, q), v| (s + (v - measured), q + (v - measured).powi(2)));
    let of = |value: f64, sum: f64, squares: f64, n: f64| {
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(LEAST_VARIANCE_M2);
        (value - mean).powi(2) / variance
    };
    let n = draws.len() as f64;
    distances[0] += of(0.0, sum, squares, n);
    for (distance, v) in distances[1..].iter_mut().zip(draws) {
        let value = v - measured;
        *distance += of(value, sum - value, squares - value * value, (n - 1.0).max(1.0));
    }
}

/// Sum of the squared distances of points from their mean.
fn spread(points: &[[f64; 2]]) -> f64 {
    let axis = |a: usize| {
        let mean = points.iter().map(|p| p[a]).sum::<f64>() / points.len() as f64;
        points.iter().map(|p| (p[a] - mean).powi(2)).sum::<f64>()
    };
    axis(0) + axis(1)
}

/// `points` in the order with the least summed squared distance from `reference`.
pub fn nearest_order(reference: &[[f64; 2]; 4], points: &[[f64; 2]; 4]) -> [[f64; 2]; 4] {
    let cost = |order: &[usize; 4]| -> f64 {
        (0..4).map(|k| (0..2).map(|a| (reference[k][a] - points[order[k]][a]).powi(2)).sum::<f64>()).sum()
    };
    // All 4^4 tuples of two-bit indices; those with four distinct ones are the 24 permutations.
    let orders = (0..256usize)
        .map(|code| std::array::from_fn(|i| code >> (2 * i) & 3))
        .filter(|o: &[usize; 4]| (0..4).all(|i| o.contains(&i)));
    let best = orders.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or([0, 1, 2, 3]);
    best.map(|i| points[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Frame;
    use catenary_core::camera::Plane;

    const CAMERA: Camera =
        Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 2.0, roll_rad: 0.0, distortion_k1: 0.0 });

    fn track(shift: f64, flip: bool) -> Track {
        let mut dlo = [[0.0, 0.1], [0.0, 0.2], [0.0, 0.3], [0.0, 0.4]].map(|[x, y]: [f64; 2]| [x + shift, y]);
        if flip {
            dlo.reverse();
        }
        let frame = Frame { time_s: 0.0, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };
        Track { frames: vec![frame], end: End::Complete }
    }

    #[test]
    fn predictions_are_matched_as_sets_and_measured_in_millimetres() {
        let draws: Vec<Track> = (0..21).map(|i| track(0.01 + 0.001 * (f64::from(i) - 10.0), i % 2 == 0)).collect();
        let p = predictive(&[(&track(0.0, false), draws)], &CAMERA).unwrap().figures;
        assert!((p.rmse_mm - 10.0).abs() < 1e-6, "{p:?}");
        assert!((p.coverage - 0.5).abs() < 1e-9, "y is inside its band, x is not: {p:?}");
        assert_eq!(p.draws, 21);
        // Four points 0.1 m apart: their variance is 5/4 of the square of that.
        assert!((p.spread_mm - 100.0 * 1.25_f64.sqrt()).abs() < 1e-6, "{p:?}");
        let centred: Vec<Track> = (0..21).map(|i| track(0.001 * (f64::from(i) - 10.0), false)).collect();
        let of = |draws: Vec<Track>| predictive(&[(&track(0.0, true), draws)], &CAMERA);
        assert_eq!(of(centred.clone()).unwrap().figures.coverage, 1.0);
        assert_eq!(of(Vec::new()), Err(Unchecked::NoDraw));
        let broken: Vec<Track> = centred.iter().cloned().chain([track(f64::NAN, false)]).collect();
        assert_eq!(of(broken), of(centred), "a track that is no number predicts nothing");
    }

    #[test]
    fn the_p_value_is_the_rank_of_the_measured_track_among_the_draws() {
        // Nineteen draws at -9 to 9 mm: only those at the ends are as far from the others as a track
        // 8.8 mm off the middle.
        let draws = || (0..19).map(|i| track(0.001 * (f64::from(i) - 9.0), false)).collect::<Vec<_>>();
        let p_value = |shift: f64| predictive(&[(&track(shift, false), draws())], &CAMERA).unwrap().figures.p_value;
        assert_eq!([p_value(0.0088), p_value(0.1), p_value(0.0)], [3.0 / 20.0, 1.0 / 20.0, 1.0]);
        // Two episodes count together: no draw is at the end of both.
        let first = track(0.0088, false);
        let mut others = draws();
        others.rotate_left(9);
        let both = predictive(&[(&first, draws()), (&first, others)], &CAMERA).unwrap();
        assert_eq!(both.figures.p_value, 1.0 / 20.0);
    }

    #[test]
    fn draws_that_end_at_the_goal_are_compared_up_to_the_earliest_end() {
        let mut measured = track(0.0, false);
        measured.frames = vec![measured.frames[0]; 4];
        let ended = |shift: f64, frames: usize| {
            let whole = track(shift, false);
            Track { frames: vec![whole.frames[0]; frames], end: End::Success }
        };
        let draws = (0..21).map(|i| ended(0.001 * (f64::from(i) - 10.0), 2 + i as usize % 2)).collect::<Vec<_>>();
        let check = predictive(&[(&measured, draws.clone())], &CAMERA).unwrap();
        assert_eq!((check.frames, check.figures.draws), ([2, 4], 21));
        // The figures are those of a measurement of two frames.
        measured.frames.truncate(2);
        let short = predictive(&[(&measured, draws)], &CAMERA).unwrap();
        assert_eq!((check.figures.clone(), short.warning()), (short.figures, None));
        let warning = check.warning().unwrap();
        assert!(warning.contains("the first 2 of 4 measured frames only"), "{warning}");
    }

    #[test]
    fn an_impossible_check_has_its_reason() {
        let mut measured = track(0.0, false);
        measured.frames.push(measured.frames[0]);
        let of = |end: End, camera: &Camera, measured: &Track| {
            predictive(&[(measured, vec![Track { end, ..track(0.0, false) }; 3])], camera)
        };
        assert_eq!(of(End::LeftWorkspace, &CAMERA, &measured), Err(Unchecked::NoDraw));
        // A camera that looks away from the plane.
        let pinhole = include_str!("../../../../launch_configs/models/soft_bar.yaml");
        let mut away = catenary_core::Model::from_yaml(pinhole).unwrap().camera.view;
        if let Camera::Pinhole(p) = &mut away {
            p.look_at_m = std::array::from_fn(|i| 2.0 * p.position_m[i] - p.look_at_m[i]);
        }
        assert_eq!(of(End::Complete, &away, &track(0.0, false)), Err(Unchecked::NotPlaced));
    }
}
