//! Judgement of a stated noise by what a recording shows.

use super::{NoiseEstimate, Series, noise_of};
use crate::data::MeasuredEpisode;
use crate::fitting::Fit;
use catenary_core::camera::HALF_MASK_PX;
use catenary_core::episode::MeasuredTrack;
use catenary_core::statistics::Z_95;
use catenary_core::{KeypointOrder, Model};
use serde::{Deserialize, Serialize};

/// Standard normal quantile of an end of an interval that a stated noise contradicts: one right noise in a thousand does.
const CLEARLY: f64 = 3.0;
/// Factor between a stated noise and the end of an interval beyond which it is overruled. Exponentially correlated noise
/// whose power at every second frame is 1.5 times that at each frame passes for white, with half of its variance.
const FACTOR: f64 = std::f64::consts::SQRT_2;

/// Noise of the keypoints: what the model file states, what the recordings show, and what is used.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeypointNoise {
    /// Standard deviation that the model file states (`camera.keypoint_noise_px`).
    pub stated_px: f64,
    /// Standard deviation that is used: the stated one, or the end of the interval next to it if the recordings contradict it.
    pub used_px: f64,
    /// Interval of 95 % of the white noise that the recordings show. It begins at 0 where their fastest part is not white noise,
    /// and bounds it from above alone. None if they show no differences.
    pub interval_px: Option<[f64; 2]>,
    /// True if the recordings show less fast noise than is stated, and the rest may be slow noise or a gap: the noise is
    /// not known.
    pub is_unknown: bool,
}

impl KeypointNoise {
    /// Noise as the model states it, before any recording.
    pub fn stated(model: &Model) -> Self {
        let stated_px = model.camera.keypoint_noise_px;
        Self { stated_px, used_px: stated_px, interval_px: None, is_unknown: false }
    }

    /// Model with the noise that is used.
    pub fn model(&self, model: &Model) -> Model {
        let mut model = model.clone();
        model.camera.keypoint_noise_px = self.used_px;
        model
    }

    /// Returns whether the recordings overrule the stated noise.
    pub fn is_overruled(&self) -> bool {
        self.used_px != self.stated_px
    }

    /// Sentence about a stated noise that the recordings contradict; none if it stands.
    pub fn doubt(&self) -> Option<String> {
        let Self { stated_px, used_px, interval_px, is_unknown } = self;
        let [low, high] = interval_px.map_or(["0".into(), "unknown".into()], |ends| ends.map(short));
        let states =
            format!("the model file states {} px of keypoint noise (camera.keypoint_noise_px)", short(*stated_px));
        let used = short(*used_px);
        match (self.is_overruled(), is_unknown) {
            (true, false) => Some(format!("{states}, and the recordings have {low} to {high} px: {used} px are used")),
            (true, true) => Some(format!(
                "{states}, and the recordings show at most {high} px of fast noise: {used} px are used, and the noise may be less"
            )),
            (false, true) => Some(format!(
                "{states}, and the recordings show at most {high} px of fast noise: the rest may be slow noise, or a gap"
            )),
            (false, false) => None,
        }
    }

    /// Judgement by another estimate, in scaled coordinates.
    #[must_use]
    fn judge(self, estimate: Option<NoiseEstimate>) -> Self {
        // A model without noise is refused elsewhere.
        let Some(estimate) = estimate.filter(|_| self.used_px > 0.0) else { return self };
        let [low, high] = [estimate.low(Z_95), estimate.high(Z_95)].map(|sd| sd * HALF_MASK_PX);
        let [least, most] = [estimate.low(CLEARLY), estimate.high(CLEARLY)].map(|sd| sd * HALF_MASK_PX);
        let is_better = self.interval_px.is_none_or(|[_, known]| high < known);
        let interval_px = if is_better { Some([low, high]) } else { self.interval_px };
        let own = Self { interval_px, ..self };
        if FACTOR * most < self.used_px {
            return match estimate.is_white() {
                true => Self { used_px: high, interval_px: Some([low, high]), is_unknown: false, ..own },
                false => Self { is_unknown: true, ..own },
            };
        }
        // Motion that is fast for the frame rate looks like noise, but moves the keypoints together.
        if least > FACTOR * self.used_px && estimate.is_independent() && estimate.is_steady {
            return Self { used_px: low, interval_px: Some([low, high]), ..own };
        }
        own
    }

    /// Judgement by the recordings themselves.
    #[must_use]
    pub fn by_recordings(self, recordings: &[MeasuredTrack], order: KeypointOrder) -> Self {
        let series: Vec<Series> = recordings.iter().map(|m| Series::of(&m.track, order)).collect();
        self.judge(noise_of(&series, 0.0))
    }

    /// Judgement by the residuals of the best fit to `episodes`, which hold less motion than the recordings.
    #[must_use]
    pub fn by_residuals(self, episodes: &[MeasuredEpisode], fit: &Fit) -> Self {
        let each = episodes.iter().zip(&fit.tracks);
        let series: Vec<Series> = each.map(|(episode, track)| Series::of_residuals(episode, track)).collect();
        let absorbed = fit.point.len() as f64 / fit.residuals.len().max(1) as f64;
        self.judge(noise_of(&series, absorbed))
    }
}

/// Number with three significant figures.
fn short(value: f64) -> String {
    let decimals = if value > 0.0 { (2.0 - value.log10().floor()).clamp(0.0, 6.0) as usize } else { 0 };
    format!("{value:.decimals$}")
}
