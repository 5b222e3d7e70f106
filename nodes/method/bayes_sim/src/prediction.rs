//! Prediction of a recording that the inference has not seen, by the posterior, and how well it comes true.
//!
//! Draws of the posterior are simulated along the recording's own grip path (or actions) from its own start. What the model
//! draws for each episode (its effects, the camera's displacement, the start's velocities) is drawn anew from its
//! distribution, since a fit tells nothing of another episode's. The noise is that of the likelihood: the stated one, or what the best
//! fit left in its place.

mod shares;

pub use shares::Shares;

use crate::diagnostics::{self, Bands, Predictive, Unchecked};
use crate::error::InferenceError;
use crate::infer::{InferenceResult, in_view, predictions};
use crate::sequential::Observed;
use crate::settings::Settings;
use catenary_core::camera::HALF_MASK_PX;
use catenary_core::episode::MeasuredTrack;
use catenary_core::posterior::Marginal;
use catenary_core::{Fidelity, Model, Policy, Posterior, Simulator, Track, seed};
use rand::RngExt;
use rand_distr::StandardNormal;
use serde::Serialize;

/// Random stream of the first prediction, beyond those of the inference.
const STREAM: u64 = 200;
/// Random streams of one prediction: posterior draws, two sets of episodes, noise.
const STREAMS: u64 = 4;
/// Number of draws: p values are multiples of 0.5 %, as those of the check of the fitted recording.
const DRAWS: usize = 199;
/// Coverage of the nominal 90 % band below which a prediction may claim too much: a band of 85 % is not worth a warning, whatever the
/// number of frames.
const LOW_COVERAGE: f64 = 0.85;
/// p value at or below which coverage is too low for chance: one right prediction in a hundred.
const IMPROBABLE: f64 = 0.01;
/// Width of the band in widths of the noise alone beyond which a prediction is wide.
const WIDE: f64 = 3.0;
/// Share of the variance from the parameters above which they make a prediction wide.
const MOST: f64 = 0.5;
/// Share of that from one parameter above which a warning names it.
const NOTABLE: f64 = 0.15;
/// Interval of a posterior, in unit coordinates, above which the recording did not determine the parameter: 90 % of the prior's own.
const UNTOLD: f64 = 0.9 * 0.9;

/// Recording that the inference does not see.
#[derive(Debug, Clone)]
pub struct Unseen<'a> {
    observed: Observed<'a>,
}

/// Prediction of a recording that the inference has not seen, and how well it came true.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prediction {
    /// Comparison with the recording.
    #[serde(flatten)]
    pub figures: Predictive,
    /// Coverage of its bands.
    #[serde(flatten)]
    pub bands: Bands,
    /// Sources of the band's width.
    pub shares: Shares,
    /// Half width in mm of the 90 % band of the noise alone.
    pub noise_half_width_mm: f64,
    /// Names of what was drawn anew for the episode.
    pub drawn_anew: Vec<String>,
    /// Names of the parameters whose posterior is as wide as the prior.
    pub undetermined: Vec<String>,
    /// Reasons not to trust the prediction.
    pub warnings: Vec<String>,
}

/// Names of the parameters whose posterior is as wide as the prior.
pub fn undetermined<'a>(posterior: &Posterior, marginals: &'a [Marginal]) -> Vec<&'a str> {
    let space = &posterior.parameters;
    let is_untold = |m: &&Marginal| {
        let prior = space.index_of(&m.name).map(|i| &space.parameters()[i].prior);
        prior.is_some_and(|p| p.to_unit(m.q95) - p.to_unit(m.q05) > UNTOLD)
    };
    marginals.iter().filter(is_untold).map(|m| m.name.as_str()).collect()
}

impl<'a> Unseen<'a> {
    /// Recording to predict, beside the recordings `seen` of the inference. `policy` is the policy of its episode, needed by a
    /// model that drives by policy.
    ///
    /// # Errors
    /// [`InferenceError::Seen`] if it is one of `seen`, [`InferenceError::OutOfView`], and [`InferenceError::Drive`] if the drive
    /// of the model is missing.
    pub fn new(
        model: &Model,
        measured: &'a MeasuredTrack,
        seen: &[MeasuredTrack],
        policy: Option<&Policy>,
    ) -> Result<Self, InferenceError> {
        if seen.iter().any(|other| other.track == measured.track) {
            return Err(InferenceError::Seen { episode: measured.name.clone() });
        }
        in_view(std::slice::from_ref(measured))?;
        // A prediction sets the fidelity that the inference had.
        Ok(Self { observed: Observed::new(model, measured, policy, Fidelity::default())? })
    }

    /// Prediction by the result `inferred` of an inference with `settings`. `number` counts the predictions of a result, from 0; `tick` may
    /// stop the simulations by an error.
    ///
    /// # Errors
    /// [`InferenceError::Unpredicted`] if no draw reaches the end of the recording, or the camera cannot place it; and those of
    /// the simulator and of `tick`.
    pub fn predicted(
        &self,
        model: &Model,
        (inferred, settings): (&InferenceResult, &Settings),
        number: u64,
        simulator: &dyn Simulator,
        tick: &mut dyn FnMut() -> Result<(), InferenceError>,
    ) -> Result<Prediction, InferenceError> {
        let stream = |i: u64| seed::derive(settings.seed, STREAM + STREAMS * number + i);
        let failed = |reason| InferenceError::Posterior { iteration: inferred.iterations.len(), reason };
        let posterior = &inferred.posterior;
        let thetas = posterior.sample(DRAWS, stream(0)).map_err(failed)?;
        let mut observed = self.observed.clone();
        // A refined posterior is that of the simulator without its discretisation error, if that counted.
        let is_fine = inferred.refinement.as_ref().is_some_and(|r| r.is_corrected);
        observed.template.fidelity = if is_fine { Fidelity::Reference } else { settings.fidelity };
        let observed = [observed];
        let mut simulated = |stream: u64| predictions(&observed, &thetas, stream, simulator, tick);
        let again = simulated(stream(2))?;
        let mut episodes = simulated(stream(1))?;
        let excess = inferred.refinement.as_ref().map_or(0.0, |r| r.noise_inflation - 1.0);
        let stated = model.camera.keypoint_noise_px / HALF_MASK_PX;
        let noise = [stated, stated * excess.sqrt()];
        let units: Vec<Vec<f64>> = thetas.iter().map(|theta| posterior.parameters.to_unit(theta)).collect();
        let shares = Shares::of([&episodes[0].1, &again[0].1], observed[0].track.frames.len(), &units, noise);
        add_noise(&mut episodes[0].1, noise[1], stream(3));
        let check = diagnostics::predictive(&episodes, &model.camera.view).map_err(|unchecked| {
            let reason = match unchecked {
                Unchecked::NoDraw => "no draw of the posterior could be simulated up to its last frame",
                Unchecked::NotPlaced => "the model's camera cannot project a keypoint to the plane of motion",
            };
            InferenceError::Unpredicted { reason }
        })?;
        let undetermined = undetermined(posterior, &inferred.marginals);
        let mut prediction = Prediction {
            noise_half_width_mm: check.figures.half_width_mm * shares.noise.sqrt(),
            drawn_anew: drawn_anew(model),
            undetermined: undetermined.iter().map(|name| (*name).to_owned()).collect(),
            warnings: Vec::new(),
            shares,
            bands: check.bands,
            figures: check.figures.clone(),
        };
        let names: Vec<&str> = posterior.parameters.parameters().iter().map(|p| p.name.as_str()).collect();
        prediction.warnings = prediction.doubts(&names);
        prediction.warnings.extend(check.warning());
        Ok(prediction)
    }
}

impl Prediction {
    /// True if the posterior claims more certainty than it has: less of the recording lies in the 90 % band than in that of
    /// nearly all draws, or it lies farther off than nearly all of them.
    pub fn is_overconfident(&self) -> bool {
        let is_improbable = is_rare(self.bands.coverage_p_value) || self.figures.is_improbable();
        self.figures.coverage < LOW_COVERAGE && is_improbable
    }

    /// True if what the fitted recordings left open makes the prediction much wider than the noise.
    pub fn is_open(&self) -> bool {
        self.figures.half_width_mm > WIDE * self.noise_half_width_mm && self.shares.parameters > MOST
    }

    /// Reasons not to trust the prediction. `names` are those of the parameters.
    fn doubts(&self, names: &[&str]) -> Vec<String> {
        let p = &self.figures;
        let mut doubts = Vec::new();
        if self.is_overconfident() {
            let cause = match self.undetermined.as_slice() {
                [] => "the posterior is narrower than the prior in every parameter, so that the model lacks what decides this \
                       motion, or its priors exclude it"
                    .to_owned(),
                open => format!(
                    "what the recording that was fitted did not determine ({}), what the model lacks or what its priors exclude decides this motion",
                    open.join(", ")
                ),
            };
            let rare = match is_rare(self.bands.coverage_p_value) {
                true => "less than of 99 % of the motions that the posterior expects",
                false => "and it lies farther off than 99 % of the motions that the posterior expects",
            };
            doubts.push(format!(
                "the 90 % bands hold {:.0} % of the unseen motion (RMSE {:.1} mm, bands ± {:.1} mm), {rare}: {cause}; do not trust its certainty",
                100.0 * p.coverage,
                p.rmse_mm,
                p.half_width_mm
            ));
        } else if p.is_improbable() {
            doubts.push(format!(
                "the unseen motion lies farther from the prediction than 99 % of the motions that the posterior expects (RMSE {:.1} mm, {:.0} % in the 90 % bands): the model lacks a part of it",
                p.rmse_mm,
                100.0 * p.coverage
            ));
        }
        if self.is_open() {
            doubts.push(format!(
                "the recording that was fitted does not determine this motion: the 90 % band of its prediction is ± {:.1} mm wide, {:.1} times the noise, and {:.0} % of that variance is what it left open{}",
                p.half_width_mm,
                p.half_width_mm / self.noise_half_width_mm,
                100.0 * self.shares.parameters,
                self.sources(names)
            ));
        }
        doubts
    }

    /// Parameters from which most of the variance comes, in brackets.
    fn sources(&self, names: &[&str]) -> String {
        let mut shared: Vec<(&str, f64)> =
            names.iter().copied().zip(self.shares.by_parameter.iter().copied()).filter(|(_, s)| *s > NOTABLE).collect();
        shared.sort_by(|a, b| b.1.total_cmp(&a.1));
        let is_untold = |name: &str| self.undetermined.iter().any(|n| n == name);
        let word = |(name, _): &(&str, f64)| match is_untold(name) {
            true => format!("{name}, as wide as its prior"),
            false => (*name).to_owned(),
        };
        match shared.as_slice() {
            [] => String::new(),
            some => format!(" (most with {})", some.iter().map(word).collect::<Vec<_>>().join("; ")),
        }
    }
}

/// True for a p value that comes from a right prediction once in a hundred times at most.
fn is_rare(p_value: f64) -> bool {
    // Shares of draws carry rounding errors.
    p_value <= IMPROBABLE * (1.0 + 1e-9)
}

/// Names of what the model draws for each episode.
fn drawn_anew(model: &Model) -> Vec<String> {
    let mut names: Vec<String> = model.effects.iter().map(|e| e.name.clone()).collect();
    let of_model = [
        (model.camera.position_jitter_m, "camera.position_jitter_m"),
        (model.observation.start_velocity_sd_m_s, "observation.start_velocity_sd_m_s"),
    ];
    names.extend(of_model.iter().filter(|(size, _)| *size > 0.0).map(|(_, name)| (*name).to_owned()));
    names
}

/// Adds noise of standard deviation `sd` to the scaled keypoints of tracks.
fn add_noise(tracks: &mut [Track], sd: f64, seed: u64) {
    if sd > 0.0 {
        let mut rng = seed::rng(seed, 0);
        let frames = tracks.iter_mut().flat_map(|t| &mut t.frames);
        frames.flat_map(|f| f.dlo.as_flattened_mut()).for_each(|v| *v += sd * rng.sample::<f64, _>(StandardNormal));
    }
}

#[cfg(test)]
mod tests;
