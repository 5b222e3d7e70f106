//! Unlike episodes: validation and held-out episodes that contradict the present model, while the fitted ones agree with it.

use super::context::{ENOUGH, Search};
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Detection, Hypothesis, detect};
use crate::report::{FurtherTest, Verifier, sentences, unlike};
use crate::settings::Settings;
use track_fit::FitError;
use track_fit::data::{MeasuredEpisode, Scope, Unknowns};
use track_fit::fitting::{CorrectedFit, Fit, OnRound, Problem, Start, calibrated, leaves_more_than_noise};

/// Stream of the first of these tests, beyond those of all tests of repaired models.
const STREAM: u64 = 500;

/// Fit of the present model to the fitted episodes and a further one, and these episodes with their fidelity correction.
type Joint = (Vec<MeasuredEpisode>, Fit);

impl Search<'_> {
    /// Tests of the present model on each validation episode, then on each held-out one.
    ///
    /// The statistic is the residual energy of the best fit to the fitted episodes and this one together, because an episode
    /// may rightly move shared unknowns that the fitted ones leave open.
    pub(super) fn test_further(&mut self, base: &Hypothesis) -> Result<Vec<FurtherTest>, FinderError> {
        let count = self.validation.len() + self.held_out.len();
        let mut tests = Vec::with_capacity(count);
        if count == 0 {
            return Ok(tests);
        }
        let settings = tested_settings(self.settings, count);
        let (problem, camera) = (self.problem, &self.question.model.camera.view);
        let verifier = Verifier { problem, episodes: &[], camera, settings: &settings };
        let kinds = [(false, self.question.validation, self.validation), (true, self.question.held_out, self.held_out)];
        let each = kinds.into_iter().flat_map(|(is_held_out, measured, episodes)| {
            measured.iter().zip(episodes).enumerate().map(move |(index, pair)| (is_held_out, index, pair))
        });
        self.reporter.pass_again();
        for (number, (is_held_out, index, (measured, episode))) in each.enumerate() {
            let part = [number, number + 1].map(|done| done as f64 / count as f64);
            let stream = STREAM + number as u64;
            let name = measured.name.clone();
            let tested = self
                .reporter
                .with_rounds_of_part(Stage::Detect, part, |on_round| test(&verifier, base, episode, stream, on_round));
            let Detection { p_value, null, .. } = tested.map_err(|error| named(error, &name))?;
            tests.push(FurtherTest { name, is_held_out, index, p_value, null_sets: null.len() });
        }
        Ok(tests)
    }

    /// Tests that contradict the present model. A conclusion tells which, or that none does.
    pub(super) fn contradicting(&mut self, tests: &[FurtherTest]) -> Result<Vec<FurtherTest>, FinderError> {
        let unlike = unlike(tests, self.settings);
        let sentence = match (tests, unlike.as_slice()) {
            ([], _) => return Ok(unlike),
            (_, []) => sentences::alike(tests),
            (_, some) => sentences::unlike(some),
        };
        self.reporter.conclude(Stage::Detect, sentence)?;
        Ok(unlike)
    }
}

/// Settings of the tests of `count` episodes.
fn tested_settings(settings: &Settings, count: usize) -> Settings {
    // With fewer null sets no p-value could reach the share of the level that each episode has.
    let least = (count as f64 / settings.level).ceil() as usize;
    // The fallback fidelity is left to the search that fits an episode which fails, for its discretisation error or otherwise.
    Settings { null_sets: settings.null_sets.max(least), fallback_fidelity: None, ..settings.clone() }
}

/// Error of the test of the named episode.
fn named(error: FinderError, name: &str) -> FinderError {
    match error {
        FinderError::NoFit(reason) => FinderError::NoFit(format!("{name}: {reason}")),
        other => other,
    }
}

/// Test of the present model on the fitted episodes and `episode` together.
fn test(
    verifier: &Verifier<'_>,
    base: &Hypothesis,
    episode: &MeasuredEpisode,
    stream: u64,
    on_round: OnRound<'_>,
) -> Result<Detection, FinderError> {
    let (episodes, fit) = match fit_near(verifier, base, episode, on_round)? {
        Some(near) if !leaves_more_than_noise(&near.1) => near,
        // The fit may have ended in another local minimum than the best one.
        near => fit_anew(verifier, near, episode, on_round)?,
    };
    detect(&joint(verifier, &episodes), &fit, verifier.settings, stream, Some(ENOUGH), on_round)
}

/// Problem of fitting the present model to `episodes`.
fn joint<'a>(verifier: &Verifier<'a>, episodes: &'a [MeasuredEpisode]) -> Problem<'a> {
    Problem { episodes, unknowns: verifier.problem.unknowns.for_episodes(episodes.len()), ..*verifier.problem }
}

/// Best fit near that of the fitted episodes; none if the episode cannot be simulated there.
fn fit_near(
    verifier: &Verifier<'_>,
    base: &Hypothesis,
    episode: &MeasuredEpisode,
    on_round: OnRound<'_>,
) -> Result<Option<Joint>, FinderError> {
    // The shared unknowns are held first, so that those of the episode alone begin at their best.
    let (episode, own) = match verifier.fitted(episode, base, on_round) {
        // The values of the fitted episodes may be impossible here, and others may do.
        Err(FinderError::NoFit(_) | FinderError::Simulator(_)) => return Ok(None),
        fitted => fitted?,
    };
    let episodes: Vec<MeasuredEpisode> = verifier.problem.episodes.iter().cloned().chain([episode]).collect();
    let joint = joint(verifier, &episodes);
    let start = Start { point: appended(&base.unknowns, &base.fit.point, &own.point), tracks: joint.measured() };
    let fit = match joint.fit(vec![start], on_round) {
        Err(FitError::NoFit(_)) => None,
        fits => fits?.into_iter().flatten().next(),
    };
    Ok(fit.map(|fit| (episodes, fit)))
}

/// Best fit from the whole range of the priors, as for fitted episodes, or `near` if that is better.
fn fit_anew(
    verifier: &Verifier<'_>,
    near: Option<Joint>,
    episode: &MeasuredEpisode,
    on_round: OnRound<'_>,
) -> Result<Joint, FinderError> {
    let fitted = verifier.problem.episodes.iter().map(MeasuredEpisode::uncorrected);
    let episodes: Vec<MeasuredEpisode> = fitted.chain([episode.clone()]).collect();
    let known = near.iter().map(|(_, fit)| fit.point.clone()).collect();
    let CorrectedFit { episodes, fit, .. } =
        calibrated(&joint(verifier, &episodes), known, &verifier.settings.of_fits(), on_round)?;
    Ok(near.filter(|(_, near)| near.cost <= fit.cost).unwrap_or((episodes, fit)))
}

/// Point of the fitted episodes and a further one: the unknowns of the fitted episodes as at `point`, those that are drawn
/// for the further episode as at its `own` point.
fn appended(unknowns: &Unknowns, point: &[f64], own: &[f64]) -> Vec<f64> {
    let single = unknowns.for_episodes(1);
    let last = unknowns.columns();
    let columns = |(i, scope): (usize, Scope)| {
        let end = if i + 1 < unknowns.list().len() { unknowns.column(i + 1, 0) } else { last };
        let further = (scope == Scope::PerEpisode).then(|| own[single.column(i, 0)]);
        point[unknowns.column(i, 0)..end].iter().copied().chain(further).collect::<Vec<f64>>()
    };
    unknowns.list().iter().map(|u| u.scope).enumerate().flat_map(columns).collect()
}

#[cfg(test)]
mod tests;
