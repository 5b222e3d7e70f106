//! Predictive bands of the present and the repaired model, for pictures.

use crate::data::MeasuredEpisode;
use crate::error::FinderError;
use crate::evidence::Hypothesis;
use crate::fitting::Problem;
use catenary_core::statistics::{self, QuantileMethod};
use catenary_core::{Camera, Track, seed};

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
    /// Prediction of the present model.
    pub before: Band,
    /// Prediction of the repaired model.
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
    /// Band of predicted tracks at the frames of the measured track.
    pub fn of(predictions: &[Track], frames: usize, camera: &Camera) -> Self {
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
        Self { q05: quantile(0.05), median: quantile(0.5), q95: quantile(0.95) }
    }
}

impl EpisodeBands {
    /// Held-out episode with the predictions of both models.
    pub(crate) fn held_out(episode: &MeasuredEpisode, before: &[Track], after: &[Track], camera: &Camera) -> Self {
        let frames = episode.measured.frames.len();
        Self {
            is_held_out: true,
            times_s: episode.measured.frames.iter().map(|f| f.time_s).collect(),
            measured: places(&episode.measured, camera),
            before: Band::of(before, frames, camera),
            after: Some(Band::of(after, frames, camera)),
        }
    }
}

/// Fitted episodes with the predictions of the present and the repaired model.
pub(crate) fn fitted_bands(
    problem: &Problem<'_>,
    before: &Hypothesis,
    after: Option<&Hypothesis>,
    camera: &Camera,
    seed: u64,
) -> Result<Vec<EpisodeBands>, FinderError> {
    let before = predictions(problem, before, seed)?;
    let after = after.map(|h| predictions(problem, h, seed)).transpose()?;
    let one = |(index, episode): (usize, &MeasuredEpisode)| {
        let frames = episode.measured.frames.len();
        let own = |draws: &[Vec<Track>]| -> Vec<Track> { draws.iter().map(|d| d[index].clone()).collect() };
        EpisodeBands {
            is_held_out: false,
            times_s: episode.measured.frames.iter().map(|f| f.time_s).collect(),
            measured: places(&episode.measured, camera),
            before: Band::of(&own(&before), frames, camera),
            after: after.as_deref().map(|draws| Band::of(&own(draws), frames, camera)),
        }
    };
    Ok(problem.episodes.iter().enumerate().map(one).collect())
}

/// Draws of the fitted episodes from the posterior, with noise, by draw and episode.
fn predictions(problem: &Problem<'_>, hypothesis: &Hypothesis, seed: u64) -> Result<Vec<Vec<Track>>, FinderError> {
    let posterior = hypothesis.posterior().ok_or_else(FinderError::curvature)?;
    let mut rng = seed::rng(seed, STREAM);
    let points: Vec<Vec<f64>> = (0..PREDICTIONS).map(|_| posterior.draw(&mut rng)).collect();
    let simulated = hypothesis.problem(problem).tracks(&points.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
    let mut noisy = |tracks: Vec<Track>| -> Vec<Track> {
        problem.episodes.iter().zip(&tracks).map(|(episode, track)| episode.measure(track, &mut rng)).collect()
    };
    Ok(simulated.into_iter().map(&mut noisy).collect())
}

fn places(track: &Track, camera: &Camera) -> PlaneTrack {
    let place = |p: [f64; 2]| camera.plane_from_scaled(p).unwrap_or([f64::NAN; 2]);
    track.frames.iter().map(|f| f.dlo.map(place)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::track::End;
    use catenary_core::{Frame, Model};

    #[test]
    fn a_band_holds_nine_tenths_of_the_predictions() {
        let model = Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let track = |i: usize| {
            let dlo = [[0.001 * i as f64, 0.0]; 4];
            let frame = Frame { time_s: 0.0, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };
            Track { frames: vec![frame; 3], end: End::Complete }
        };
        let band = Band::of(&(0..101).map(track).collect::<Vec<_>>(), 5, &model.camera.view);
        let x = |i: usize| places(&track(i), &model.camera.view)[0][0][0];
        assert_eq!((band.q05[0][2][0], band.median[4][0][0], band.q95[1][3][0]), (x(5), x(50), x(95)));
    }
}
