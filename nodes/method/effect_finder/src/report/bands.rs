//! Predictive bands of the present and the repaired model, for pictures.

use super::draws::Draws;
use crate::evidence::Hypothesis;
use catenary_core::statistics::{self, QuantileMethod};
use catenary_core::{Camera, Track, seed};
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::Problem;

/// Random stream of the bands' predictions.
const STREAM: u64 = 2201;
/// Number of predictions behind a band.
const PREDICTIONS: usize = 40;

/// Keypoints of an episode in the plane of motion, m: (x, z) by frame and keypoint; NaN if a line of sight misses the
/// plane.
pub type PlaneTrack = Vec<[[f64; 2]; 4]>;

/// Measured keypoints of an episode with the predictive bands of both models.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeBands {
    /// Held-out episode, which no fit has seen.
    pub is_held_out: bool,
    /// Times of the frames, s.
    pub times_s: Vec<f64>,
    /// Measured keypoints.
    pub measured: PlaneTrack,
    /// Prediction of the present model; none if too few of its draws can be simulated.
    pub before: Option<Band>,
    /// Prediction of the repaired model; none without such a model, or if too few of its draws can be simulated.
    pub after: Option<Band>,
}

/// Predictive band: quantiles of each coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// 5 % quantile.
    pub q05: PlaneTrack,
    /// Median.
    pub median: PlaneTrack,
    /// 95 % quantile.
    pub q95: PlaneTrack,
}

impl Band {
    /// Band of predicted tracks at the frames of the measured track; none for fewer than half of the `wanted` predictions,
    /// because draws that fail may be the extreme ones.
    pub fn of(predictions: &[Track], wanted: usize, frames: usize, camera: &Camera) -> Option<Self> {
        if predictions.is_empty() || 2 * predictions.len() < wanted {
            return None;
        }
        let tracks: Vec<PlaneTrack> = predictions.iter().map(|t| places(t, camera)).collect();
        let quantile = |q: f64| -> PlaneTrack {
            let at = |frame: usize, k: usize, axis: usize| {
                // An episode that ended early stands still from then on.
                let value =
                    |places: &PlaneTrack| places.get(frame.min(places.len().saturating_sub(1))).map(|p| p[k][axis]);
                let mut values: Vec<f64> = tracks.iter().filter_map(value).collect();
                values.sort_by(f64::total_cmp);
                statistics::quantile(&values, q, QuantileMethod::Nearest)
            };
            (0..frames).map(|f| std::array::from_fn(|k| std::array::from_fn(|axis| at(f, k, axis)))).collect()
        };
        Some(Self { q05: quantile(0.05), median: quantile(0.5), q95: quantile(0.95) })
    }
}

impl EpisodeBands {
    /// Held-out episode with predictions of both models, `wanted` of each.
    pub(crate) fn held_out(
        episode: &MeasuredEpisode,
        [before, after]: [&[Track]; 2],
        wanted: usize,
        camera: &Camera,
    ) -> Self {
        let frames = episode.measured.frames.len();
        Self {
            is_held_out: true,
            times_s: episode.measured.frames.iter().map(|f| f.time_s).collect(),
            measured: places(&episode.measured, camera),
            before: Band::of(before, wanted, frames, camera),
            after: Band::of(after, wanted, frames, camera),
        }
    }
}

/// Fitted episodes with the predictions of the present and the repaired model, and the number of draws that could not be
/// simulated.
pub(crate) fn fitted_bands(
    problem: &Problem<'_>,
    before: &Hypothesis,
    after: Option<&Hypothesis>,
    camera: &Camera,
    seed: u64,
) -> (Vec<EpisodeBands>, usize) {
    let mut left_out = 0;
    let mut predicted = |hypothesis| {
        let (tracks, failed) = predictions(problem, hypothesis, seed);
        left_out += failed;
        tracks
    };
    let before = predicted(before);
    let after = after.map(predicted);
    let one = |(index, episode): (usize, &MeasuredEpisode)| {
        let frames = episode.measured.frames.len();
        let band = |draws: &[Vec<Track>]| {
            let own: Vec<Track> = draws.iter().map(|d| d[index].clone()).collect();
            Band::of(&own, PREDICTIONS, frames, camera)
        };
        EpisodeBands {
            is_held_out: false,
            times_s: episode.measured.frames.iter().map(|f| f.time_s).collect(),
            measured: places(&episode.measured, camera),
            before: band(&before),
            after: after.as_deref().and_then(band),
        }
    };
    (problem.episodes.iter().enumerate().map(one).collect(), left_out)
}

/// Draws of the fitted episodes from the posterior, with noise, by draw and episode, and the number of draws that could not
/// be simulated.
fn predictions(problem: &Problem<'_>, hypothesis: &Hypothesis, seed: u64) -> (Vec<Vec<Track>>, usize) {
    // A picture is no reason to fail a search: a fit without a posterior has no band.
    let Some(posterior) = hypothesis.posterior() else { return (Vec::new(), 0) };
    let mut rng = seed::rng(seed, STREAM);
    let Draws { tracks, left_out } = Draws::of(&hypothesis.problem(problem), PREDICTIONS, || posterior.draw(&mut rng));
    let mut noisy = |tracks: Vec<Track>| -> Vec<Track> {
        problem.episodes.iter().zip(&tracks).map(|(episode, track)| episode.measure(track, &mut rng)).collect()
    };
    (tracks.into_iter().map(&mut noisy).collect(), left_out)
}

fn places(track: &Track, camera: &Camera) -> PlaneTrack {
    let place = |p: [f64; 2]| camera.plane_from_scaled(p).unwrap_or([f64::NAN; 2]);
    track.frames.iter().map(|f| f.dlo.map(place)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Effort, Evidence};
    use catenary_core::track::End;
    use catenary_core::{Frame, Model};
    use std::ops::ControlFlow;
    use track_fit::fitting::{FidelityCorrection, Start};
    use track_fit::toy::{self, Toy};

    #[test]
    fn a_band_holds_nine_tenths_of_the_predictions() {
        let model = Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let track = |i: usize| {
            let dlo = [[0.001 * i as f64, 0.0]; 4];
            let frame = Frame { time_s: 0.0, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None };
            Track { frames: vec![frame; 3], end: End::Complete }
        };
        let all: Vec<Track> = (0..101).map(track).collect();
        let band = Band::of(&all, 101, 5, &model.camera.view).unwrap();
        let x = |i: usize| places(&track(i), &model.camera.view)[0][0][0];
        assert_eq!((band.q05[0][2][0], band.median[4][0][0], band.q95[1][3][0]), (x(5), x(50), x(95)));
        assert!(Band::of(&all[..50], 100, 5, &model.camera.view).is_some());
        assert_eq!(Band::of(&all[..49], 100, 5, &model.camera.view), None, "the failed half may be the extreme draws");
    }
    /// Fit of the toy at a length of 0.2003 m. The toy refuses lengths under 0.2 m, so that half of the draws fail.
    #[test]
    fn bands_do_without_draws_that_cannot_be_simulated() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.2003, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        let present = Hypothesis {
            candidates: Vec::new(),
            unknowns: problem.unknowns.clone(),
            episodes: None,
            correction: FidelityCorrection::Untried,
            fit,
            evidence: Evidence { alone: 0.0, with: Vec::new() },
            effort: Effort::Searched,
            spread: Vec::new(),
        };
        let (bands, left_out) = fitted_bands(&problem, &present, None, &toy::model().camera.view, 1);
        assert!(bands[0].before.is_some() && (20..=80).contains(&left_out), "{left_out} of at most 120");
        // The length is known well, and lies at 0.195 m, so that nearly all draws fail.
        let mut short = present.fit.clone();
        short.point[0] = 0.0;
        short.jacobian *= 100.0;
        let short = Hypothesis { fit: short, ..present.clone() };
        let (bands, left_out) = fitted_bands(&problem, &present, Some(&short), &toy::model().camera.view, 1);
        assert!(bands[0].before.is_some() && bands[0].after.is_none() && left_out > 120, "{left_out}");
    }
}
