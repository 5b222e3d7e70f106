//! Value of a repair on episodes that no fit has seen: validation or held-out episodes.

use super::decide::ClosedGap;
use serde::{Deserialize, Serialize};

/// Scores of predictions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Root mean square distance of keypoints, mm.
    pub rmse_mm: f64,
    /// Energy score of the four keypoints together, mm, mean over frames (Gneiting and Raftery 2007); none if no draw of the
    /// predictions can be simulated.
    pub energy_mm: Option<f64>,
}

/// Value of a repair on validation or held-out episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verification {
    /// Number of episodes.
    pub episodes: usize,
    /// True for validation episodes, which chose between models, so that the scores are somewhat too good. False for held-out
    /// episodes, which chose no model.
    pub selects: bool,
    /// Scores of the present model.
    pub before: Score,
    /// Scores of the repaired model.
    pub after: Score,
    /// Noise floor: root mean square distance of the repaired model on repeats simulated from it, mm; none if no repeat can
    /// be simulated.
    pub floor_mm: Option<f64>,
    /// Closed share of the gap in root mean square distance, (before - after) / (before - floor); none if the present
    /// model is at the floor, or if there is no floor.
    pub gap_closed: Option<f64>,
    /// 5 and 95 % quantiles of the closed share, by a block bootstrap over frames. None if too many draws show no gap, or if the
    /// episodes themselves show none: neither model has an excess residual energy, and the repaired one passes its test.
    pub interval: Option<[f64; 2]>,
    /// p-value of the hypothesis that the repaired model, with its posterior, explains the episodes; none if it can
    /// hardly be simulated.
    pub p_value: Option<f64>,
    /// Number of null data sets of that test. The least p-value is 1 / (1 + this number).
    pub null_sets: usize,
    /// Number of draws of the predictions of both models that could not be simulated, and are left out.
    pub draws_left_out: usize,
    /// Share of the present model's excess residual energy that the repair removes. 0 if only the repaired model has an
    /// excess, none if neither has.
    pub share_explained: Option<f64>,
    /// Gain in log likelihood by the repair, nats, each model at the best fit of its episodes' own unknowns. A negative
    /// gain speaks against the repair.
    pub log_likelihood_gain: f64,
    /// Best effect that is not named, repaired the same way: its name and scores.
    pub wrong_effect: Option<(String, Score)>,
    /// Root mean square distance of the present model with the regression of its residual, mm.
    pub black_box_mm: Option<f64>,
}

impl Verification {
    /// Closed share of the gap with its interval; none if the episodes show no gap.
    pub fn closed(&self) -> Option<ClosedGap> {
        self.gap_closed.zip(self.interval).map(|(share, interval)| ClosedGap { share, interval })
    }
}
