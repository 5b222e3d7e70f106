//! What a search gives: the finding, the model to go on with, and what its pictures show.

use crate::case::Case;
use crate::error::FinderError;
use crate::fit::Problem;
use crate::hypothesis::Hypothesis;
use crate::verdict::{Finding, Verdict};
use catenary_core::{Camera, Model, Track, seed};

/// Random stream of the predictions in pictures.
const STREAM: u64 = 2201;
/// Predictions behind a band.
const PREDICTIONS: usize = 40;

/// What a search gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The finding.
    pub finding: Finding,
    /// The repaired model, where effects were found.
    pub model: Option<Model>,
    /// What pictures show, an entry an episode: those that models were fitted to, then the held-out ones.
    pub shown: Vec<Shown>,
}

impl Outcome {
    /// Takes over that the gap closes beyond the edge of a prior, too: which effects close it within says nothing more of them
    /// than that they are alternatives.
    pub(crate) fn is_at_the_edge(&mut self) {
        if !matches!(self.finding.verdict, Verdict::Named | Verdict::CannotTellApart) {
            self.finding.found.clear();
        }
        (self.finding.verdict, self.model) = (Verdict::PriorTooNarrow, None);
    }
}

/// Keypoints of an episode in the plane of motion, m: (x, z) by frame and keypoint; NaN where a line of sight misses it.
pub type Places = Vec<[[f64; 2]; 4]>;

/// What pictures show of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// Whether no fit has seen it.
    pub is_held_out: bool,
    /// Times of the frames, s.
    pub times_s: Vec<f64>,
    /// What was measured.
    pub measured: Places,
    /// What the present model predicts.
    pub before: Band,
    /// What the model with the most probable effects predicts.
    pub after: Option<Band>,
}

/// The predictive band of a model: quantiles of each coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// 5 %.
    pub q05: Places,
    /// 50 %.
    pub median: Places,
    /// 95 %.
    pub q95: Places,
}

impl Band {
    /// That of predicted tracks, at the frames of the measured one.
    pub fn of(predictions: &[Track], frames: usize, camera: &Camera) -> Self {
        let tracks: Vec<Places> = predictions.iter().map(|t| places(t, camera)).collect();
        let quantile = |q: f64| -> Places {
            let at = |frame: usize, k: usize, axis: usize| {
                let value = |places: &Places| places.get(frame.min(places.len().saturating_sub(1))).map(|p| p[k][axis]);
                let mut values: Vec<f64> = tracks.iter().filter_map(value).collect();
                values.sort_by(f64::total_cmp);
                values.get((q * (values.len().saturating_sub(1)) as f64).round() as usize).copied().unwrap_or(f64::NAN)
            };
            (0..frames).map(|f| std::array::from_fn(|k| std::array::from_fn(|axis| at(f, k, axis)))).collect()
        };
        Self { q05: quantile(0.05), median: quantile(0.5), q95: quantile(0.95) }
    }
}

impl Shown {
    /// A held-out episode with what both models predict of it.
    pub(crate) fn held_out(case: &Case, before: &[Track], after: &[Track], camera: &Camera) -> Self {
        let frames = case.measured.frames.len();
        Self {
            is_held_out: true,
            times_s: case.measured.frames.iter().map(|f| f.time_s).collect(),
            measured: places(&case.measured, camera),
            before: Band::of(before, frames, camera),
            after: Some(Band::of(after, frames, camera)),
        }
    }
}

/// The fitted episodes, with what the present model and the best one predict of them.
pub(crate) fn fitted(
    problem: &Problem<'_>,
    before: &Hypothesis,
    after: Option<&Hypothesis>,
    camera: &Camera,
    seed: u64,
) -> Result<Vec<Shown>, FinderError> {
    let before = predictions(problem, before, seed)?;
    let after = after.map(|h| predictions(problem, h, seed)).transpose()?;
    let one = |(episode, case): (usize, &Case)| {
        let frames = case.measured.frames.len();
        let own = |draws: &[Vec<Track>]| -> Vec<Track> { draws.iter().map(|d| d[episode].clone()).collect() };
        Shown {
            is_held_out: false,
            times_s: case.measured.frames.iter().map(|f| f.time_s).collect(),
            measured: places(&case.measured, camera),
            before: Band::of(&own(&before), frames, camera),
            after: after.as_deref().map(|draws| Band::of(&own(draws), frames, camera)),
        }
    };
    Ok(problem.cases.iter().enumerate().map(one).collect())
}

/// Draws of the fitted episodes with noise, by draw and episode.
fn predictions(problem: &Problem<'_>, hypothesis: &Hypothesis, seed: u64) -> Result<Vec<Vec<Track>>, FinderError> {
    let posterior = hypothesis.posterior().ok_or_else(FinderError::curvature)?;
    let mut rng = seed::rng(seed, STREAM);
    let points: Vec<Vec<f64>> = (0..PREDICTIONS).map(|_| posterior.draw(&mut rng)).collect();
    let simulated = hypothesis.problem(problem).tracks(&points.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
    let mut noisy = |tracks: Vec<Track>| -> Vec<Track> {
        problem.cases.iter().zip(&tracks).map(|(case, track)| case.measure(track, &mut rng)).collect()
    };
    Ok(simulated.into_iter().map(&mut noisy).collect())
}

fn places(track: &Track, camera: &Camera) -> Places {
    let place = |p: [f64; 2]| camera.plane_from_scaled(p).unwrap_or([f64::NAN; 2]);
    track.frames.iter().map(|f| f.dlo.map(place)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Frame;
    use catenary_core::track::End;

    #[test]
    fn a_band_holds_nine_tenths_of_the_predictions() {
        let model = Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap();
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
