//! What should make one doubt a posterior.

use catenary_core::mixture::MixtureError;
use catenary_core::track::End;
use catenary_core::{Camera, Posterior, Track};
use serde::{Deserialize, Serialize};

/// Draws behind the check of the prior's edges.
const EDGE_DRAWS: usize = 4_000;
/// Part of the prior's range, at either end, that counts as its edge.
const EDGE: f64 = 0.05;
/// Share of the posterior at an edge from which it counts as pressed against it: six times what the prior has there.
const PRESSED: f64 = 0.3;
/// Share of the mixture outside the support that is worth a warning. What lies outside is no error in itself: of three parameters
/// that are not known at all, widened as far as can be, seven tenths do.
const OUTSIDE: f64 = 0.75;
/// Effective samples below which a mixture density network has too little to learn from.
const FEW_SAMPLES: f64 = 100.0;
/// Coverage of the nominal 90 % band below which the model cannot have produced the measurement.
const LOW_COVERAGE: f64 = 0.6;
/// p value of the predictive check from which the model counts as unable to make the measurement.
const IMPROBABLE: f64 = 0.02;
/// Half widths of the predictive band that predictions of a result are off by, from which it fits nothing: 5 of them are 8
/// standard deviations, at every keypoint.
const FAR_HALF_WIDTHS: f64 = 5.0;
/// Spreads of the measured keypoints about their own middle that predictions are off by, from which no band is wide enough.
const FAR_SPREADS: f64 = 3.0;
/// Coverage of the nominal 90 % band below which next to nothing of the measurement is in it.
const NO_COVERAGE: f64 = 0.3;
/// Variance that draws are taken to have at least: a hundredth of a millimetre is nothing that a camera sees.
const LEAST_VARIANCE_M2: f64 = 1e-10;
/// Quantiles of the predictive band.
const BAND: [f64; 2] = [0.05, 0.95];

/// How well posterior draws predict the measured track. Keypoints are matched as sets: each frame's four in the order that
/// lies nearest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Predictive {
    /// Root mean square distance, in mm, of the predicted mean from the measured keypoints.
    pub rmse_mm: f64,
    /// Share of measured coordinates inside the 5 % to 95 % band of the draws; 0.9 is calibrated.
    pub coverage: f64,
    /// Root mean square half width of the band in mm.
    pub half_width_mm: f64,
    /// Root mean square distance, in mm, of the measured keypoints from their own middle: what a prediction of nothing but
    /// that middle would be off by.
    pub spread_mm: f64,
    /// Share of draws at least as far from the others' mean as the measured tracks are from theirs, these among them: the
    /// p value of a posterior predictive check. Small means that the model does not make such tracks.
    pub p_value: f64,
    /// Draws that reached every measured frame, all of them in finite numbers.
    pub draws: usize,
}

/// Why posterior draws were not compared with the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unchecked {
    /// No draw could be simulated up to the last measured frame.
    NoDraw,
    /// Each draw that could be simulated reached the goal of the task, and ended, before the last measured frame of an episode.
    GoalReached,
    /// The camera cannot place a keypoint in the plane of motion.
    NotPlaced,
}

impl Unchecked {
    /// What to say of a posterior that does fit, as far as is known; nothing where [`misfit`] speaks.
    pub fn warning(self) -> Option<String> {
        let why = match self {
            Self::NoDraw => return None,
            Self::GoalReached => {
                "every simulated draw reached the goal and ended before the last measured frame; set task.success_reward to 2, which nothing reaches, to have them go on"
            }
            Self::NotPlaced => "the model's camera cannot place a keypoint in the plane of motion",
        };
        Some(format!("the posterior's predictions were not compared with the measurement: {why}"))
    }
}

/// Measured keypoints outside of what the camera sees.
pub fn out_of_view(track: &Track) -> usize {
    let inside = |p: &&[f64; 2]| p.iter().all(|v| (-1.0..=1.0).contains(v));
    track.frames.iter().flat_map(|f| &f.dlo).filter(|p| !inside(p)).count()
}

/// Compares tracks simulated from posterior draws, noise included, with the measured ones: for each measured episode, its
/// track and those of the draws.
///
/// # Errors
/// [`Unchecked`] where no draw reached every measured frame of all of them, or the camera cannot place a keypoint.
pub fn predictive(episodes: &[(&Track, Vec<Track>)], camera: &Camera) -> Result<Predictive, Unchecked> {
    let finite = |t: &Track| t.frames.iter().all(|f| f.dlo.as_flattened().iter().all(|v| v.is_finite()));
    let draws = episodes.iter().map(|(_, tracks)| tracks.len()).min().unwrap_or(0);
    let reaches = |m: &Track, t: &Track| t.frames.len() >= m.frames.len();
    let all = |i: usize, check: &dyn Fn(&Track, &Track) -> bool| episodes.iter().all(|(m, t)| check(m, &t[i]));
    let whole: Vec<usize> = (0..draws).filter(|i| all(*i, &|m, t| reaches(m, t) && finite(t))).collect();
    if whole.is_empty() {
        let ended = (0..draws).any(|i| all(i, &|m, t| finite(t) && (reaches(m, t) || t.end == End::Success)));
        return Err(if ended { Unchecked::GoalReached } else { Unchecked::NoDraw });
    }
    let place = |p: [f64; 2]| camera.plane_from_scaled(p).ok_or(Unchecked::NotPlaced);
    let (mut squares, mut widths, mut inside, mut count) = (0.0, 0.0, 0usize, 0usize);
    let mut measured_points: Vec<[f64; 2]> = Vec::new();
    let mut distances = vec![0.0; whole.len() + 1];
    for (measured, tracks) in episodes {
        for (i, frame) in measured.frames.iter().enumerate() {
            let drawn: Vec<[[f64; 2]; 4]> =
                whole.iter().map(|&t| nearest_order(&frame.dlo, &tracks[t].frames[i].dlo)).collect();
            for k in 0..4 {
                let seen = place(frame.dlo[k])?;
                measured_points.push(seen);
                let points = drawn.iter().map(|d| place(d[k])).collect::<Result<Vec<[f64; 2]>, Unchecked>>()?;
                for axis in 0..2 {
                    let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
                    add_distances(&mut distances, &values, seen[axis]);
                    values.sort_by(f64::total_cmp);
                    let mean = values.iter().sum::<f64>() / values.len() as f64;
                    let [low, high] = BAND.map(|q| quantile(&values, q));
                    squares += (mean - seen[axis]).powi(2);
                    widths += (0.5 * (high - low)).powi(2);
                    inside += usize::from((low..=high).contains(&seen[axis]));
                    count += 1;
                }
            }
        }
    }
    let farther = distances[1..].iter().filter(|d| **d >= distances[0]).count();
    // Two coordinates make one keypoint's distance.
    let root = |sum: f64, n: f64| 1e3 * (sum / n).sqrt();
    if count == 0 {
        return Err(Unchecked::NoDraw);
    }
    Ok(Predictive {
        rmse_mm: root(squares, 0.5 * count as f64),
        coverage: inside as f64 / count as f64,
        half_width_mm: root(widths, count as f64),
        spread_mm: root(spread(&measured_points), 0.5 * count as f64),
        p_value: (farther + 1) as f64 / distances.len() as f64,
        draws: whole.len(),
    })
}

/// Adds to each of `distances` (the measured value's, then each draw's) the squared distance of a value from the mean of the
/// draws, in their standard deviations; a draw is held against the others.
fn add_distances(distances: &mut [f64], draws: &[f64], measured: f64) {
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

/// Summed squared distance of points from their mean.
fn spread(points: &[[f64; 2]]) -> f64 {
    let axis = |a: usize| {
        let mean = points.iter().map(|p| p[a]).sum::<f64>() / points.len() as f64;
        points.iter().map(|p| (p[a] - mean).powi(2)).sum::<f64>()
    };
    axis(0) + axis(1)
}

/// Linear interpolation between order statistics.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let place = q * (sorted.len().max(1) - 1) as f64;
    let (below, share) = (place.floor() as usize, place.fract());
    let at = |i: usize| sorted.get(i).or(sorted.last()).copied().unwrap_or(f64::NAN);
    at(below) + share * (at(below + 1) - at(below))
}

/// `points` in the order whose summed squared distance from `reference` is least.
pub fn nearest_order(reference: &[[f64; 2]; 4], points: &[[f64; 2]; 4]) -> [[f64; 2]; 4] {
    let cost = |order: &[usize; 4]| -> f64 {
        (0..4).map(|k| (0..2).map(|a| (reference[k][a] - points[order[k]][a]).powi(2)).sum::<f64>()).sum()
    };
    let orders = (0..256usize)
        .map(|code| std::array::from_fn(|i| code >> (2 * i) & 3))
        .filter(|o: &[usize; 4]| (0..4).all(|i| o.contains(&i)));
    let best = orders.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or([0, 1, 2, 3]);
    best.map(|i| points[i])
}

/// A warning for each edge of the prior that the posterior presses on.
pub fn edges(posterior: &Posterior) -> Result<Vec<String>, MixtureError> {
    let draws = posterior.sample(EDGE_DRAWS, 0)?;
    let mut warnings = Vec::new();
    for (i, p) in posterior.parameters.parameters().iter().enumerate() {
        let share = |near: &dyn Fn(f64) -> bool| {
            draws.iter().filter(|t| near(p.prior.to_unit(t[i]))).count() as f64 / draws.len() as f64
        };
        let (low, high) = p.prior.bounds();
        let sides: [(&str, f64, f64); 2] =
            [("lower", low, share(&|u| u < EDGE)), ("upper", high, share(&|u| u > 1.0 - EDGE))];
        for (side, bound, at_edge) in sides {
            if at_edge > PRESSED {
                warnings.push(format!(
                    "{}: {:.0} % of the posterior lies in the {:.0} % of the prior next to its {side} bound {bound}: the prior may be too narrow, and the posterior falsely certain",
                    p.name,
                    100.0 * at_edge,
                    100.0 * EDGE
                ));
            }
        }
    }
    Ok(warnings)
}

/// Warnings from the figures of a whole inference.
pub fn doubts(mass_outside: f64, effective_sample_size: f64, predictive: Option<&Predictive>) -> Vec<String> {
    let mut warnings = Vec::new();
    if mass_outside > OUTSIDE {
        warnings.push(format!("{:.0} % of the mixture lies outside the prior's support", 100.0 * mass_outside));
    }
    if effective_sample_size < FEW_SAMPLES {
        warnings.push(format!(
            "the simulations count as {effective_sample_size:.0} effective samples only: more are needed"
        ));
    }
    if let Some(p) = predictive.filter(|p| p.coverage < LOW_COVERAGE) {
        warnings.push(format!(
            "only {:.0} % of the measured keypoints lie in the 90 % band of the posterior's predictions: the model lacks something that the measurement has",
            100.0 * p.coverage
        ));
    }
    if let Some(p) = predictive.filter(|p| p.p_value <= IMPROBABLE) {
        warnings.push(format!(
            "the measurement lies farther from the posterior's predictions than {:.0} of {} draws of it lie from the others (p = {:.3}): the model does not make such tracks",
            p.draws as f64 + 1.0 - p.p_value * (p.draws as f64 + 1.0),
            p.draws,
            p.p_value
        ));
    }
    if let Some(p) = predictive.filter(|p| p.rmse_mm > p.spread_mm) {
        warnings.push(format!(
            "the predictions are off by {:.1} mm, the measured keypoints' own middle by {:.1} mm only: the model and the recording are not one another's",
            p.rmse_mm, p.spread_mm
        ));
    }
    warnings
}

/// Why a posterior fits nothing of the measurement, in words, where its check failed outright: no draw can be simulated, or none is as far
/// from the others as the measurement is, and that lies far outside of the band or beyond what its own middle would predict.
/// A model that merely lacks something is warned of by [`doubts`].
pub fn misfit(predictive: &Result<Predictive, Unchecked>) -> Option<String> {
    let p = match predictive {
        Ok(p) => p,
        Err(Unchecked::NoDraw) => {
            return Some("no draw of the posterior could be simulated up to the last measured frame".into());
        }
        // Nothing is known that speaks against the posterior: a warning tells that.
        Err(Unchecked::GoalReached | Unchecked::NotPlaced) => return None,
    };
    let is_rank_last = p.p_value * (p.draws as f64 + 1.0) <= 1.0 + 1e-9;
    let is_far = p.coverage < NO_COVERAGE && p.rmse_mm > FAR_HALF_WIDTHS * p.half_width_mm;
    // Where the posterior is wide, the draws lie as far apart as the measurement lies from them.
    let is_foreign = p.rmse_mm.is_nan() || p.rmse_mm > FAR_SPREADS * p.spread_mm;
    (is_foreign || is_rank_last && (is_far || p.rmse_mm > p.spread_mm)).then(|| {
        format!(
            "the predictions are {:.1} mm off the measured keypoints on average, {:.0} times the half width of their 90 % band, and {:.0} % of the keypoints lie in it: check model, units, frames and clocks of the recording",
            p.rmse_mm,
            p.rmse_mm / p.half_width_mm,
            100.0 * p.coverage
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::camera::Plane;
    use catenary_core::{Frame, Mixture, Parameter, ParameterSpace, Prior};
    use nalgebra::{DMatrix, DVector};

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
        let p = predictive(&[(&track(0.0, false), draws)], &CAMERA).unwrap();
        assert!((p.rmse_mm - 10.0).abs() < 1e-6, "{p:?}");
        assert!((p.coverage - 0.5).abs() < 1e-9, "y is inside its band, x is not: {p:?}");
        assert_eq!(p.draws, 21);
        // Four points 0.1 m apart: their variance is 5/4 of the square of that.
        assert!((p.spread_mm - 100.0 * 1.25_f64.sqrt()).abs() < 1e-6, "{p:?}");
        let centred: Vec<Track> = (0..21).map(|i| track(0.001 * (f64::from(i) - 10.0), false)).collect();
        let of = |draws: Vec<Track>| predictive(&[(&track(0.0, true), draws)], &CAMERA);
        assert_eq!(of(centred.clone()).unwrap().coverage, 1.0);
        assert_eq!(of(Vec::new()), Err(Unchecked::NoDraw));
        let broken: Vec<Track> = centred.iter().cloned().chain([track(f64::NAN, false)]).collect();
        assert_eq!(of(broken), of(centred), "a track that is no number predicts nothing");
    }

    #[test]
    fn the_p_value_is_the_rank_of_the_measured_track_among_the_draws() {
        // Nineteen draws at -9 to 9 mm: only those at the ends are as far from the others as a track
        // 8.8 mm off the middle.
        let draws = || (0..19).map(|i| track(0.001 * (f64::from(i) - 9.0), false)).collect::<Vec<_>>();
        let p_value = |shift: f64| predictive(&[(&track(shift, false), draws())], &CAMERA).unwrap().p_value;
        assert_eq!([p_value(0.0088), p_value(0.1), p_value(0.0)], [3.0 / 20.0, 1.0 / 20.0, 1.0]);
        // Two episodes count together: no draw is at the end of both.
        let first = track(0.0088, false);
        let mut others = draws();
        others.rotate_left(9);
        let both = predictive(&[(&first, draws()), (&first, others)], &CAMERA).unwrap();
        assert_eq!(both.p_value, 1.0 / 20.0);
    }

    #[test]
    fn a_posterior_at_an_edge_says_so() {
        let p = Parameter { name: "length_m".into(), prior: Prior::Uniform { low: 1.0, high: 2.0 } };
        let space = ParameterSpace::new(vec![p]).unwrap();
        let at = |mean: f64| {
            let mixture =
                Mixture::new(&[1.0], vec![DVector::from_element(1, mean)], vec![DMatrix::from_element(1, 1, 4e-4)])
                    .unwrap();
            edges(&Posterior { parameters: space.clone(), mixture }).unwrap()
        };
        assert_eq!(at(0.5), Vec::<String>::new());
        assert!(at(0.99)[0].contains("upper bound 2") && at(0.99)[0].contains("length_m"));
    }

    #[test]
    fn a_result_that_fits_nothing_is_told_from_one_of_a_model_that_lacks_something() {
        let good =
            Predictive { rmse_mm: 1.0, coverage: 0.9, half_width_mm: 2.0, spread_mm: 100.0, p_value: 0.4, draws: 50 };
        let lowest = 1.0 / 51.0;
        let misfit = |check: Result<Predictive, Unchecked>| super::misfit(&check);
        assert_eq!(misfit(Ok(good.clone())), None);
        assert_eq!(misfit(Ok(Predictive { p_value: lowest, coverage: 0.5, rmse_mm: 4.0, ..good })), None);
        assert_eq!(misfit(Ok(Predictive { p_value: 2.0 * lowest, coverage: 0.1, rmse_mm: 15.0, ..good })), None);
        let far = misfit(Ok(Predictive { p_value: lowest, coverage: 0.1, rmse_mm: 15.0, ..good })).unwrap();
        assert!(far.contains("15.0 mm off") && far.contains("8 times") && far.contains("10 %"), "{far}");
        assert!(misfit(Ok(Predictive { rmse_mm: 2e6, half_width_mm: 1e6, ..good })).is_some());
        // Of a posterior after a few simulations.
        let wide = Predictive { rmse_mm: 150.0, half_width_mm: 90.0, coverage: 0.4, p_value: 0.09, ..good };
        assert_eq!(misfit(Ok(wide.clone())), None);
        assert!(misfit(Ok(Predictive { p_value: lowest, ..wide })).is_some());
        assert!(misfit(Ok(Predictive { rmse_mm: f64::NAN, ..good })).is_some());
        assert!(misfit(Err(Unchecked::NoDraw)).unwrap().contains("no draw"));
    }

    #[test]
    fn a_check_that_could_not_be_made_says_why_and_is_no_misfit() {
        let mut measured = track(0.0, false);
        measured.frames.push(measured.frames[0]);
        let of = |end: End, camera: &Camera, measured: &Track| {
            predictive(&[(measured, vec![Track { end, ..track(0.0, false) }; 3])], camera)
        };
        let reached = of(End::Success, &CAMERA, &measured);
        assert_eq!(reached, Err(Unchecked::GoalReached));
        assert_eq!(super::misfit(&reached), None);
        assert!(Unchecked::GoalReached.warning().unwrap().contains("reached the goal"));
        assert_eq!(of(End::LeftWorkspace, &CAMERA, &measured), Err(Unchecked::NoDraw));
        // A camera that looks away from the plane.
        let pinhole = include_str!("../../../launch_configs/models/soft_bar.yaml");
        let mut away = catenary_core::Model::from_yaml(pinhole).unwrap().camera.view;
        if let Camera::Pinhole(p) = &mut away {
            p.look_at_m = std::array::from_fn(|i| 2.0 * p.position_m[i] - p.look_at_m[i]);
        }
        assert_eq!(of(End::Complete, &away, &track(0.0, false)), Err(Unchecked::NotPlaced));
    }

    #[test]
    fn doubts_are_worded_with_their_numbers() {
        let good =
            Predictive { rmse_mm: 1.0, coverage: 0.9, half_width_mm: 2.0, spread_mm: 100.0, p_value: 0.4, draws: 50 };
        assert!(doubts(0.01, 500.0, Some(&good)).is_empty());
        let bad = Predictive { coverage: 0.3, ..good };
        let words = doubts(0.8, 20.0, Some(&bad));
        assert!(words.len() == 3 && words[2].contains("30 %"), "{words:?}");
        let strange = Predictive { p_value: 1.0 / 51.0, ..good };
        let words = doubts(0.01, 500.0, Some(&strange));
        assert!(
            words.len() == 1 && words[0].contains("than 50 of 50 draws") && words[0].contains("0.020"),
            "{words:?}"
        );
        let foreign = Predictive { rmse_mm: 495.0, ..good };
        let words = doubts(0.01, 500.0, Some(&foreign));
        assert!(words.len() == 1 && words[0].contains("495.0 mm") && words[0].contains("100.0 mm"), "{words:?}");
    }
}
