//! Calibration: the noise of the keypoints, and the best fit of the present model at a fidelity that suffices.

use super::progress::{Reporter, Stage};
use super::question::Question;
use crate::error::FinderError;
use crate::report::sentences;
use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::{DifferentiableSimulator, KeypointOrder, Model};
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::{CorrectedFit, Problem, calibrated};
use track_fit::noise::KeypointNoise;

/// Calibrated present model, with the validation and the held-out episodes at the same fidelity.
pub(super) struct Calibration {
    /// Present model with the noise that is used.
    pub model: Model,
    pub noise: KeypointNoise,
    pub present: CorrectedFit,
    pub validation: Vec<MeasuredEpisode>,
    pub held_out: Vec<MeasuredEpisode>,
}

/// Fits the present model to the measured episodes. A stated noise that the recordings contradict is overruled before the fit,
/// and one that its residuals contradict after it; the fit is then repeated.
pub(super) fn calibrate(
    question: &Question<'_>,
    simulator: &dyn DifferentiableSimulator,
    settings: &Settings,
    reporter: &mut Reporter<'_>,
) -> Result<Calibration, FinderError> {
    let order = KeypointOrder::of(question.model.observation.drive);
    let seen = KeypointNoise::stated(question.model).by_recordings(question.measured, order);
    let first = calibrate_with(question, seen, Vec::new(), simulator, settings, reporter)?;
    let noise = seen.by_residuals(&first.present.episodes, &first.present.fit);
    if noise.used_px == seen.used_px {
        return Ok(Calibration { noise, ..first });
    }
    calibrate_with(question, noise, vec![first.present.fit.point], simulator, settings, reporter)
}

/// Fits the present model with `noise` to the measured episodes, from `known` points and draws. If the discretisation error is too
/// large for a correction, the fit is repeated at the fallback fidelity.
fn calibrate_with(
    question: &Question<'_>,
    noise: KeypointNoise,
    known: Vec<Vec<f64>>,
    simulator: &dyn DifferentiableSimulator,
    settings: &Settings,
    reporter: &mut Reporter<'_>,
) -> Result<Calibration, FinderError> {
    let model = noise.model(question.model);
    let episodes = |measured: &[MeasuredTrack]| -> Result<Vec<MeasuredEpisode>, FinderError> {
        measured.iter().map(|m| Ok(MeasuredEpisode::new(&model, m, &settings.of_fits())?)).collect()
    };
    let fitted = episodes(question.measured)?;
    let (validation, held_out) = (episodes(question.validation)?, episodes(question.held_out)?);
    let present = fit_present(&model, fitted, simulator, known, settings, reporter)?;
    // Without a finer fidelity the discretisation error is unknown, so that nothing shows that a fallback is needed.
    let fallback = settings.fallback_fidelity.filter(|_| settings.finer_fidelity.is_some());
    let Some(fallback) = fallback.filter(|_| present.is_too_coarse()) else {
        return Ok(Calibration { model, noise, present, validation, held_out });
    };
    reporter.conclude(Stage::Calibrate, sentences::finer(fallback))?;
    let at = |episodes: &[MeasuredEpisode]| -> Vec<_> { episodes.iter().map(|e| e.at(fallback)).collect() };
    // The fallback fidelity is used even if it is too coarse itself: there is no finer one to fall back to.
    let last = Settings { fallback_fidelity: None, ..settings.clone() };
    let known = vec![present.fit.point];
    let present = fit_present(&model, at(&present.episodes), simulator, known, &last, reporter)?;
    let (validation, held_out) = (at(&validation), at(&held_out));
    Ok(Calibration { model, noise, present, validation, held_out })
}

/// Best fit of the present model to `episodes`, from `known` points and draws.
fn fit_present(
    model: &Model,
    episodes: Vec<MeasuredEpisode>,
    simulator: &dyn DifferentiableSimulator,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    reporter: &mut Reporter<'_>,
) -> Result<CorrectedFit, FinderError> {
    reporter.report(Stage::Calibrate, 0.0, None)?;
    let problem = Problem::of(model, &episodes, simulator, settings.rounds);
    reporter.with_progress(Stage::Calibrate, |on_round| calibrated(&problem, known, &settings.of_fits(), on_round))
}
