//! Context of a search: everything that its steps share.

use super::progress::{Reporter, Stage};
use super::question::Question;
use crate::error::FinderError;
use crate::evidence::{Detection, Extent, Hypothesis, Ranking, Test, detect};
use crate::report::{Agreement, EpisodeBands, Fitness, Verification, Verifier, fitted_bands, hidden_sds, sentences};
use crate::settings::Settings;
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::{Fit, Problem};
use track_fit::noise::KeypointNoise;

/// Number of the most probable models that are refined and extended.
pub(super) const PARENTS: usize = 3;
/// Excess residual energy of a model with one effect, in standard deviations of noise, above which other local minima
/// are searched.
pub(super) const FOUND_SDS: f64 = 2.0;
/// Least decrease of the cost of a better fit: a hundredth of a log Bayes factor.
pub(super) const LEAST_DECREASE: f64 = 0.02;
/// Null sets with at least the measured T after which a test stops whose p-value alone matters: it is then far above the
/// level.
pub(super) const ENOUGH: usize = 20;

/// Result of naming.
pub(super) struct Named {
    /// Ranking of the candidate models.
    pub ranking: Ranking,
    /// Most probable model with its test; none if no candidate is probable.
    pub best: Option<Best>,
    /// Gain in log posterior by a template in the place of all effects of the best model, nats; none if it is below
    /// `least_log_bayes_factor`, or if the likeliest rival keeps some of the effects.
    pub rival_gain: Option<f64>,
}

/// Most probable model with effects.
pub(super) struct Best {
    /// The model.
    pub hypothesis: Hypothesis,
    /// Extent to which it explains the fitted episodes.
    pub extent: Extent,
    /// Fit with its test.
    pub fitness: Fitness,
}

/// Verification of a repair on validation or held-out episodes, with their predictive bands.
pub(super) struct Checked {
    /// Comparison with the present model.
    pub verification: Verification,
    /// Predictive bands of both models.
    pub bands: Vec<EpisodeBands>,
}

/// Search after the calibration of the present model. Its steps are methods in the files of this folder.
pub(super) struct Search<'a> {
    /// Input of the search.
    pub question: Question<'a>,
    /// Noise of the keypoints.
    pub noise: KeypointNoise,
    /// Problem of fitting the present model.
    pub problem: &'a Problem<'a>,
    /// Validation episodes.
    pub validation: &'a [MeasuredEpisode],
    /// Held-out episodes.
    pub held_out: &'a [MeasuredEpisode],
    /// Settings of the search.
    pub settings: &'a Settings,
    /// Reporter of progress and conclusions.
    pub reporter: Reporter<'a>,
}

impl<'a> Search<'a> {
    /// Test of a fitted model.
    pub fn detect(
        &mut self,
        problem: &Problem<'_>,
        fit: &Fit,
        stream: u64,
        stage: Stage,
    ) -> Result<Detection, FinderError> {
        // The test of a repaired model may stop early. That of the present model must not, because the localisation
        // needs all of its null sets.
        let enough = (stage == Stage::Repair).then_some(ENOUGH);
        let settings = self.settings;
        self.reporter.report(stage, 0.0, None)?;
        self.reporter.with_rounds(stage, |on_round| detect(problem, fit, settings, stream, enough, on_round))
    }

    /// Root mean square distance of keypoints, mm, of the largest gap that the test of the present model may not see. None if a line
    /// of sight misses the plane of motion.
    pub fn hidden_gap_mm(&self, test: &Test) -> Option<f64> {
        let noise_mm = self.problem.episodes.iter().filter_map(|e| e.noise_mm(&self.question.model.camera.view));
        Some(hidden_sds(test, self.settings.level) * noise_mm.reduce(f64::max)?)
    }

    /// Agreement of a fit with the data.
    pub fn agreement(&self, problem: &Problem<'_>, fit: &Fit) -> Result<Agreement, FinderError> {
        Agreement::new(problem, fit, &self.question.model.camera.view, self.settings)
    }

    /// Predictive bands of the fitted episodes, for pictures. Draws that cannot be simulated are left out, and a conclusion
    /// says so.
    pub fn bands(
        &mut self,
        present: &Hypothesis,
        repaired: Option<&Hypothesis>,
    ) -> Result<Vec<EpisodeBands>, FinderError> {
        let camera = &self.question.model.camera.view;
        let (bands, left_out) = fitted_bands(self.problem, present, repaired, camera, self.settings.seed);
        if left_out > 0 {
            let stage = if repaired.is_some() { Stage::Repair } else { Stage::Localise };
            self.reporter.conclude(stage, sentences::left_out_of_pictures(left_out, &bands, repaired.is_some()))?;
        }
        Ok(bands)
    }

    /// Verifier of models on the validation episodes.
    pub fn verifier(&self) -> Verifier<'a> {
        self.verifier_on(self.validation)
    }

    /// Verifier of models on `episodes`.
    pub fn verifier_on(&self, episodes: &'a [MeasuredEpisode]) -> Verifier<'a> {
        let camera = &self.question.model.camera.view;
        Verifier { problem: self.problem, episodes, camera, settings: self.settings }
    }
}
