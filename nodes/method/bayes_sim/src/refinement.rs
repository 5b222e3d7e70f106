//! Refinement of a posterior: the networks' posterior gives the starts, and the simulator itself is the likelihood.
//!
//! A network that was trained on some thousand simulations knows where the posterior is, and not how sharp it is. The
//! refinement fits the model from draws of the networks and of the prior, and draws from the exact posterior of the
//! parameters and of what the model draws for each episode (`track_fit::sampling`). Its likelihood is that of the model
//! file: independent Gaussian noise of `camera.keypoint_noise_px` on each keypoint coordinate, and of `observation.wrench` on the wrench.
//! Noise of keypoints that the recordings contradict is overruled ([`KeypointNoise`]).

mod episodes;

use crate::diagnostics::{self, PredictiveCheck, Unchecked};
use crate::sequential::PART;
use crate::settings::Settings;
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::Until;
use catenary_core::{
    Fidelity, KeypointOrder, Model, Posterior, SimulationRequest, Simulator, SimulatorError, Track, seed,
};
use episodes::{at_wrench_noise, corrected, episodes_with};
use serde::{Deserialize, Serialize};
use std::cell::Cell;
use std::ops::ControlFlow;
use track_fit::data::{Offset, Scope, Unknowns, rmse_mm};
use track_fit::fitting::{Fit, OnRound, Problem, Start, modes, noise_inflation};
use track_fit::noise::KeypointNoise;
use track_fit::sampling::{Budget, Draws, draws, gaussians_of};
use track_fit::{Differences, FitError};

/// Random stream of the refinement, beyond those of the iterations and of the predictive check.
const STREAM: u64 = 104;
/// Draws of the networks' posterior among which fits start.
const FROM_NETWORKS: usize = 64;
/// Draws of the priors, and of the neighbourhood of the networks' draws, among which fits start.
const FROM_PRIORS: usize = 128;
/// Points of which one must be simulated.
const PROBES: usize = 3;
/// Fits.
const STARTS: usize = 8;
/// Rounds of a fit.
const ROUNDS: usize = 40;
/// Change of a mean over the last block of moves, in standard deviations, above which the draws have not settled.
const UNSETTLED: f64 = 0.25;
/// Share of accepted moves under which the draws have hardly moved.
const STUCK: f64 = 0.02;
/// Share of the likelihood's noise that a better fit must leave for another sampling.
const LESS_NOISE: f64 = 0.8;
/// Distance of the posterior's mean prediction beyond that of the best fit, as a share of it, that is worth a warning.
const WORSE: f64 = 0.5;
/// Number of simulations at which a refinement is shown as half done; its number is not known beforehand.
const HALF_DONE: f64 = 4_000.0;

/// Value of an unknown at the best fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fitted {
    /// Name of the parameter or the effect.
    pub name: String,
    /// Number of the episode, from 1, of a value that is drawn for each episode; none for a parameter.
    pub episode: Option<usize>,
    /// Value in the unit of its name.
    pub value: f64,
}

/// Account of a refinement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refinement {
    /// Best fit: the parameters, then what the model draws for each episode.
    pub best_fit: Vec<Fitted>,
    /// Root mean square distance of the best fit's keypoints from the measured ones, mm.
    pub best_fit_rmse_mm: f64,
    /// Mean squared residual of the best fit in variances of the used noise; about 1 if the model and its noise are right.
    pub best_fit_residual: f64,
    /// Noise of the keypoints: stated, seen in the recordings, and used; none in files of earlier versions.
    #[serde(default)]
    pub noise: Option<KeypointNoise>,
    /// Variance of the likelihood's noise in variances of the used noise: 1, or that of the best fit's residuals if they leave
    /// more than the used noise.
    pub noise_inflation: f64,
    /// Variance of the likelihood's noise of the wrench in variances of the stated one, before `noise_inflation`: 1, or that of the best
    /// fit's residuals of the wrench.
    #[serde(default = "as_stated", skip_serializing_if = "is_as_stated")]
    pub wrench_inflation: f64,
    /// Root mean square distance of the mean prediction of the networks' posterior, mm; none if it could not be simulated.
    pub networks_rmse_mm: Option<f64>,
    /// Width of the 90 % interval of the networks' posterior, by parameter (D), in the parameter's unit.
    pub networks_width: Vec<f64>,
    /// Number of minima that share the posterior.
    pub modes: usize,
    /// True if the simulations carry a correction of their discretisation error.
    pub is_corrected: bool,
    /// Steps in which the likelihood's power grew from 0 to 1.
    pub steps: usize,
    /// Share of the walkers' moves that were accepted.
    pub acceptance: f64,
    /// Greatest change of a coordinate's mean over the last block of moves, in its standard deviations.
    pub drift: f64,
    /// Number of simulations of an episode.
    pub simulations: usize,
}

fn as_stated() -> f64 {
    1.0
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_as_stated(inflation: &f64) -> bool {
    *inflation == as_stated()
}

impl Refinement {
    /// Reasons to doubt the refined posterior; none if it settled. `rmse_mm` is that of its mean prediction.
    pub fn warnings(&self, rmse_mm: Option<f64>) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.drift > UNSETTLED || self.acceptance < STUCK {
            warnings.push(format!(
                "the refinement of the posterior did not settle: a mean still moved by {:.1} standard deviations in the last block of moves, of which {:.0} % were accepted; its intervals may be wrong",
                self.drift,
                100.0 * self.acceptance
            ));
        }
        warnings.extend(self.noise.as_ref().and_then(KeypointNoise::doubt));
        if self.noise_inflation > 1.0 {
            let is_overruled = self.noise.is_some_and(|noise| noise.is_overruled());
            let noise = match is_overruled {
                true => "this noise",
                false => "the noise that the model file states (camera.keypoint_noise_px)",
            };
            warnings.push(format!(
                "the best fit leaves {:.1} times {noise}: the intervals are those of what it leaves; find-effects may tell what the model lacks",
                self.noise_inflation.sqrt()
            ));
        }
        if self.wrench_inflation > 1.0 {
            warnings.push(format!(
                "the best fit leaves {:.1} times the noise of the wrench that the model file states (observation.wrench): its part of the intervals is that of this noise; a bias or delay of the sensor, or find-effects, may tell what the model lacks",
                self.wrench_inflation.sqrt()
            ));
        }
        let best_mm = self.best_fit_rmse_mm;
        if let Some(rmse_mm) = rmse_mm.filter(|rmse_mm| *rmse_mm > (1.0 + WORSE) * best_mm) {
            warnings.push(format!(
                "the model can follow the recording to {best_mm:.1} mm, and the mean prediction of this posterior is {rmse_mm:.1} mm off: the posterior is wider than the best fit deserves, or misses it"
            ));
        }
        warnings
    }
}

/// Refined posterior.
pub struct Refined {
    /// Posterior over the parameters.
    pub posterior: Posterior,
    /// Account.
    pub refinement: Refinement,
    /// Posterior predictive check; none if no draws were requested.
    pub predictive: Option<Result<PredictiveCheck, Unchecked>>,
}

/// Refines the posterior `networks` of `model` from the episodes `measured`. `on_share` hears the share that is done, and
/// may stop the refinement.
///
/// # Errors
/// [`FitError`]: the model states no noise, nothing can be simulated, or `on_share` breaks.
pub fn refine(
    model: &Model,
    measured: &[MeasuredTrack],
    networks: &Posterior,
    settings: &Settings,
    simulator: &dyn Simulator,
    on_share: &mut dyn FnMut(f64, usize) -> ControlFlow<()>,
) -> Result<Refined, FitError> {
    // The support of the networks' posterior may have moved.
    let model = Model { theta: networks.parameters.clone(), ..model.clone() };
    let seed = seed::derive(settings.seed, STREAM);
    let of_fits = track_fit::Settings {
        draws: FROM_PRIORS,
        starts: STARTS,
        fidelity: settings.fidelity,
        fallback_fidelity: None,
        finer_fidelity: (settings.fidelity != Fidelity::Reference).then_some(Fidelity::Reference),
        seed,
    };
    let order = KeypointOrder::of(model.observation.drive);
    let seen = KeypointNoise::stated(&model).by_recordings(measured, order);
    let episodes = episodes_with(&model, seen, measured, &of_fits)?;
    let unknowns = Unknowns::of(&model, episodes.len());
    let counted = Counted { simulator, episodes: Cell::new(0) };
    let differences = Differences::new(&counted, &unknowns);
    let problem = Problem::of(&model, &episodes, &differences, ROUNDS);
    let mut on_round = || {
        let count = counted.episodes.get();
        on_share(count as f64 / (count as f64 + HALF_DONE), count)
    };
    let outside = |reason| FitError::NoFit(format!("the networks' posterior: {reason}"));
    let thetas = networks.sample(FROM_NETWORKS, seed).map_err(outside)?;
    let known: Vec<Vec<f64>> = thetas.iter().map(|theta| problem.unknowns.point_at(theta)).collect();
    // A simulator that cannot set what a model draws for each episode refuses each point: the first few tell.
    first_simulated(&problem, &known)?;
    let networks_rmse_mm = mean_rmse_mm(&problem, &known, &model, &mut on_round)?;
    let mut first = modes(&problem, known, &of_fits, &mut on_round)?;
    // The residuals hold less motion than the recordings, and may show less noise than these.
    let noise = seen.by_residuals(&episodes, &first[0]);
    let episodes = episodes_with(&model, noise, measured, &of_fits)?;
    let problem = Problem { episodes: &episodes, unknowns: problem.unknowns.clone(), ..problem };
    if noise.used_px != seen.used_px {
        first = modes(&problem, first.into_iter().map(|mode| mode.point).collect(), &of_fits, &mut on_round)?;
    }
    let (corrected, modes, is_corrected) = corrected(&problem, first, of_fits.finer_fidelity, &mut on_round)?;
    let (corrected, modes, wrench_inflation) = at_wrench_noise(&problem, (corrected, modes), &mut on_round)?;
    let problem = Problem { episodes: &corrected, unknowns: problem.unknowns.clone(), ..problem };
    let (drawn, modes) = drawn(&problem, modes, seed, &mut on_round)?;
    let posterior = posterior_of(&problem, &drawn, networks, seed)?;
    let predictive = (settings.predictive_draws > 0)
        .then(|| {
            predictive(&problem, (&drawn.points, settings.predictive_draws), measured, &model, seed, &mut on_round)
        })
        .transpose()?;
    let best = &modes[0];
    let width = |p: &Posterior| p.marginals().map(|all| all.iter().map(|m| m.q95 - m.q05).collect::<Vec<f64>>());
    let offsets: Vec<_> =
        corrected.iter().zip(&best.tracks).flat_map(|(e, track)| e.offsets_mm(track, &model.camera.view)).collect();
    let refinement = Refinement {
        best_fit: fitted(&problem, &best.point),
        best_fit_rmse_mm: rmse_mm(offsets.iter()),
        best_fit_residual: best.cost / best.residuals.len() as f64,
        noise: Some(noise),
        noise_inflation: drawn.inflation,
        wrench_inflation,
        networks_rmse_mm,
        networks_width: width(networks).map_err(outside)?,
        modes: modes.len(),
        is_corrected,
        steps: drawn.steps,
        acceptance: drawn.acceptance,
        drift: drawn.drift,
        simulations: counted.episodes.get(),
    };
    Ok(Refined { posterior, refinement, predictive })
}

/// Simulator that counts its episodes.
struct Counted<'a> {
    simulator: &'a dyn Simulator,
    episodes: Cell<usize>,
}

impl Simulator for Counted<'_> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        self.episodes.set(self.episodes.get() + request.thetas.len());
        self.simulator.simulate(request)
    }

    fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
        self.episodes.set(self.episodes.get() + request.thetas.len());
        self.simulator.simulate_until(request, until)
    }

    fn range_of(&self, name: &str) -> Option<[f64; 2]> {
        self.simulator.range_of(name)
    }
}

/// Values of all unknowns at a point.
fn fitted(problem: &Problem<'_>, point: &[f64]) -> Vec<Fitted> {
    let unknowns = &problem.unknowns;
    let mut all = Vec::new();
    for (i, unknown) in unknowns.list().iter().enumerate() {
        let is_shared = unknown.scope == Scope::Shared;
        for episode in 0..if is_shared { 1 } else { problem.episodes.len() } {
            all.push(Fitted {
                name: unknown.name.clone(),
                episode: (!is_shared).then_some(episode + 1),
                value: unknown.prior.from_unit(point[unknowns.column(i, episode)]),
            });
        }
    }
    all
}

/// Returns the error of the simulator if it can simulate none of the first points.
fn first_simulated(problem: &Problem<'_>, points: &[Vec<f64>]) -> Result<(), FitError> {
    let mut refusal = None;
    for point in points.iter().take(PROBES) {
        match problem.tracks(&[point]) {
            Ok(_) => return Ok(()),
            Err(error) => refusal = Some(error),
        }
    }
    refusal.map_or(Ok(()), |error| Err(error.into()))
}

/// Root mean square distance of the mean of the tracks at these points from the measured ones, mm; none if no point can be
/// simulated to the end.
fn mean_rmse_mm(
    problem: &Problem<'_>,
    points: &[Vec<f64>],
    model: &Model,
    on_round: OnRound<'_>,
) -> Result<Option<f64>, FitError> {
    let whole = |tracks: &Vec<Track>| {
        tracks.iter().zip(problem.episodes).all(|(t, e)| t.frames.len() == e.measured.frames.len())
    };
    let sets: Vec<Vec<Track>> = simulated(problem, points, on_round)?.into_iter().filter(whole).collect();
    if sets.is_empty() {
        return Ok(None);
    }
    let count = sets.len() as f64;
    let mut all = Vec::new();
    for (i, episode) in problem.episodes.iter().enumerate() {
        let offsets = sets.iter().map(|set| episode.offsets_mm(&set[i], &model.camera.view));
        let sum = offsets.reduce(|sum, new| sum.into_iter().zip(new).map(|(a, b)| added(a, b)).collect());
        all.extend(sum.into_iter().flatten().map(|offset| offset.map(|o| o.map(|v| v / count))));
    }
    Ok(Some(rmse_mm(all.iter())))
}

/// Tracks at those of the points that can be simulated, in parts between which `on_round` may break.
fn simulated(problem: &Problem<'_>, points: &[Vec<f64>], on_round: OnRound<'_>) -> Result<Vec<Vec<Track>>, FitError> {
    let mut sets = Vec::with_capacity(points.len());
    for part in points.chunks(PART) {
        sets.extend(problem.tracks_each(part).into_iter().flatten());
        if on_round().is_break() {
            return Err(FitError::Cancelled);
        }
    }
    Ok(sets)
}

/// Sum of two offsets of a frame.
fn added(a: Offset, b: Offset) -> Offset {
    a.zip(b).map(|(a, b)| std::array::from_fn(|i| a[i] + b[i]))
}

/// Draws of the posterior, and the modes with the best fit that the walkers led to.
fn drawn(
    problem: &Problem<'_>,
    mut modes: Vec<Fit>,
    seed: u64,
    on_round: OnRound<'_>,
) -> Result<(Draws, Vec<Fit>), FitError> {
    loop {
        let drawn = draws(problem, &modes, Budget::default(), seed, on_round)?;
        // Walkers cover the priors, and may have met a minimum that no fit had ended in.
        let start = Start { point: drawn.best.clone(), tracks: problem.measured() };
        let polished = match problem.fit(vec![start], on_round) {
            Err(FitError::NoFit(_)) => None,
            fits => fits?.into_iter().flatten().next(),
        };
        if let Some(better) = polished.filter(|fit| fit.cost < modes[0].cost) {
            let is_same = !problem.unknowns.are_apart(&better.point, &modes[0].point);
            if is_same {
                modes[0] = better;
            } else {
                modes.insert(0, better);
            }
        }
        // A better fit may leave less noise than the likelihood had; each round lowers it, so that the loop ends.
        let left = noise_inflation(&modes[0]);
        if left > LESS_NOISE * drawn.inflation && (left > 1.0 || drawn.inflation == 1.0) {
            return Ok((drawn, modes));
        }
    }
}

/// Posterior over the parameters: a mixture of Gaussians for the draws.
fn posterior_of(problem: &Problem<'_>, drawn: &Draws, networks: &Posterior, seed: u64) -> Result<Posterior, FitError> {
    let parameters = networks.parameters.clone();
    let unit = |point: &Vec<f64>| {
        let values = problem.unknowns.values(point, 0);
        parameters.to_unit(&values[..parameters.dimension()]).iter().map(|u| u.clamp(0.0, 1.0)).collect()
    };
    let units: Vec<Vec<f64>> = drawn.points.iter().map(unit).collect();
    let none = || FitError::NoFit("the draws have no mixture of Gaussians".into());
    let mixture = gaussians_of(&units, seed).ok_or_else(none)?;
    Posterior::new(parameters, mixture).map_err(|reason| FitError::NoFit(reason.to_string()))
}

/// Posterior predictive check by `count` of the draws: their tracks with noise, each with what was drawn for its episodes.
fn predictive(
    problem: &Problem<'_>,
    (draws, count): (&[Vec<f64>], usize),
    measured: &[MeasuredTrack],
    model: &Model,
    seed: u64,
    on_round: OnRound<'_>,
) -> Result<Result<PredictiveCheck, Unchecked>, FitError> {
    let some: Vec<Vec<f64>> = (0..count).map(|i| draws[i * draws.len() / count].clone()).collect();
    let mut rng = seed::rng(seed, 1);
    let mut episodes: Vec<(&Track, Vec<Track>)> = measured.iter().map(|m| (&m.track, Vec::new())).collect();
    for tracks in simulated(problem, &some, on_round)? {
        for ((place, episode), track) in episodes.iter_mut().zip(problem.episodes).zip(&tracks) {
            let mut noisy = episode.measure(track, &mut rng);
            // Frames after the end of a simulation were not predicted.
            noisy.frames.truncate(track.frames.len());
            place.1.push(noisy);
        }
    }
    Ok(diagnostics::predictive(&episodes, &model.camera.view))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Prior;
    use track_fit::toy::twisted::Mirrored;
    use track_fit::toy::{self, Toy};

    const TRUTH: [f64; 2] = [0.265, 2e4];

    fn settings() -> Settings {
        Settings { predictive_draws: 50, ..Settings::default() }
    }

    /// Model whose lengths the toy accepts.
    fn model() -> Model {
        let mut model = toy::model();
        let mut parameters = model.theta.parameters().to_vec();
        parameters[0].prior = Prior::Uniform { low: 0.21, high: 0.29 };
        model.theta = catenary_core::ParameterSpace::new(parameters).unwrap();
        model
    }

    fn noisy(toy: &Toy, seed: u64) -> MeasuredTrack {
        let track = toy::episode(toy, TRUTH, &[]).measured_anew(&mut seed::rng(seed, 0)).measured;
        MeasuredTrack { track, ..toy::measured(toy, TRUTH, &[]) }
    }

    fn refined(model: &Model, simulator: &dyn Simulator, measured: &MeasuredTrack) -> Result<Refined, FitError> {
        let networks = Posterior::prior(model.theta.clone());
        let measured = std::slice::from_ref(measured);
        refine(model, measured, &networks, &settings(), simulator, &mut |_, _| ControlFlow::Continue(()))
    }

    /// Mean and standard deviation of each parameter's unit coordinate, by a grid.
    fn exact(model: &Model, simulator: &Toy, measured: &MeasuredTrack) -> [[f64; 2]; 2] {
        let of_fits = track_fit::Settings { fidelity: Fidelity::Standard, ..track_fit::Settings::default() };
        let episodes = [track_fit::data::MeasuredEpisode::new(model, measured, &of_fits).unwrap()];
        let problem = Problem::of(model, &episodes, simulator, 1);
        let at = |i: u32| (f64::from(i) + 0.5) / 200.0;
        let grid: Vec<Vec<f64>> = (0..200).flat_map(|i| (0..200).map(move |j| vec![at(i), at(j)])).collect();
        let costs = problem.costs(&grid, &problem.measured());
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = costs.iter().map(|c| (-0.5 * (c - least)).exp()).collect();
        let total: f64 = weights.iter().sum();
        [0, 1].map(|i| {
            let mean: f64 = grid.iter().zip(&weights).map(|(u, w)| u[i] * w / total).sum();
            let square: f64 = grid.iter().zip(&weights).map(|(u, w)| (u[i] - mean).powi(2) * w / total).sum();
            [mean, square.sqrt()]
        })
    }

    #[test]
    fn a_refined_posterior_is_the_exact_one() {
        let (toy, model) = (Toy { gain: 0.1 }, model());
        for seed in 0..3 {
            let measured = noisy(&toy, seed);
            let Refined { posterior, refinement, predictive } = refined(&model, &toy, &measured).unwrap();
            let draws = posterior.sample(2000, 1).unwrap();
            for (i, [mean, sd]) in exact(&model, &toy, &measured).into_iter().enumerate() {
                let units: Vec<f64> = draws.iter().map(|theta| model.theta.to_unit(theta)[i]).collect();
                let own = units.iter().sum::<f64>() / 2000.0;
                let spread = (units.iter().map(|u| (u - own).powi(2)).sum::<f64>() / 2000.0).sqrt();
                // 256 walkers: a mean scatters by 0.06 standard deviations, and a standard deviation by 5 %.
                assert!(
                    (own - mean).abs() < 0.25 * sd && (spread / sd - 1.0).abs() < 0.2,
                    "{seed} {i}: {own} {mean}, {spread} {sd}"
                );
            }
            assert_eq!((refinement.modes, refinement.noise_inflation, refinement.best_fit.len()), (1, 1.0, 2));
            assert!((refinement.best_fit[0].value - TRUTH[0]).abs() < 0.01, "{:?}", refinement.best_fit);
            assert!((0.6..1.4).contains(&refinement.best_fit_residual), "{}", refinement.best_fit_residual);
            let check = predictive.unwrap().unwrap().figures;
            assert!(!check.is_in_doubt() && refinement.warnings(Some(check.rmse_mm)).is_empty(), "{check:?}");
        }
    }

    #[test]
    fn two_lengths_that_look_alike_both_stay() {
        let (toy, model) = (Toy { gain: 0.3 }, model());
        let mirrored = Mirrored { toy: Toy { gain: 0.3 }, at: 0.25 };
        let Refined { posterior, refinement, .. } = refined(&model, &mirrored, &noisy(&toy, 4)).unwrap();
        let draws = posterior.sample(1000, 1).unwrap();
        let short = draws.iter().filter(|theta| theta[0] < 0.25).count();
        assert!(refinement.modes == 2 && (350..650).contains(&short), "{short} of 1000 in {} modes", refinement.modes);
    }

    /// Variance of the likelihood's noise in variances of the stated noise.
    fn left(refinement: &Refinement) -> f64 {
        let noise = refinement.noise.unwrap();
        refinement.noise_inflation * (noise.used_px / noise.stated_px).powi(2)
    }

    #[test]
    fn noise_that_contradicts_the_recording_is_overruled() {
        let (toy, mut model) = (Toy { gain: 0.1 }, model());
        let measured = noisy(&toy, 5);
        let width = |model: &Model| {
            let Refined { posterior, refinement, .. } = refined(model, &toy, &measured).unwrap();
            let length = &posterior.marginals().unwrap()[0];
            (length.q95 - length.q05, refinement)
        };
        let (right, _) = width(&model);
        model.camera.keypoint_noise_px /= 4.0;
        let (stated_too_low, refinement) = width(&model);
        assert!((left(&refinement) / 16.0 - 1.0).abs() < 0.3, "{}", left(&refinement));
        assert!((stated_too_low / right - 1.0).abs() < 0.2, "{stated_too_low} {right}");
        let told = "the model file states 0.175 px of keypoint noise";
        assert!(refinement.warnings(None)[0].starts_with(told), "{:?}", refinement.warnings(None));
        // Four times the noise that the recording has. The upper end of what twenty frames tell of it is used.
        model.camera.keypoint_noise_px *= 16.0;
        let (stated_too_high, refinement) = width(&model);
        assert!((0.8..2.5).contains(&(left(&refinement) * 16.0)), "{}", left(&refinement));
        assert!((0.8..1.6).contains(&(stated_too_high / right)), "{stated_too_high} {right}");
        let told = "the model file states 2.80 px of keypoint noise";
        assert!(refinement.warnings(None)[0].starts_with(told), "{:?}", refinement.warnings(None));
    }

    #[test]
    fn a_gaussian_prior_keeps_its_width_where_the_noise_is_overruled() {
        let (toy, mut model) = (Toy { gain: 0.01 }, model());
        let mut parameters = model.theta.parameters().to_vec();
        parameters[1].prior = Prior::Normal { mean: 2e4, sd: 2e3, low: 1e3, high: 5e4 };
        model.theta = catenary_core::ParameterSpace::new(parameters).unwrap();
        let measured = noisy(&toy, 8);
        model.camera.keypoint_noise_px /= 4.0;
        let Refined { posterior, refinement, .. } = refined(&model, &toy, &measured).unwrap();
        let modulus = &posterior.marginals().unwrap()[1];
        // The tracks hardly depend on the modulus.
        assert!(left(&refinement) > 10.0, "{}", left(&refinement));
        assert!((0.8..1.15).contains(&(modulus.sd / 2e3)), "{modulus:?}");
    }

    /// Simulator that counts its requests and refuses them.
    struct Refusing(Cell<usize>);

    impl Simulator for Refusing {
        fn simulate(&self, _: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
            self.0.set(self.0.get() + 1);
            Err(SimulatorError::Input("camera_scale_change: unknown".into()))
        }
    }

    #[test]
    fn a_simulator_that_refuses_is_not_asked_a_hundred_times() {
        let (model, refusing) = (model(), Refusing(Cell::new(0)));
        let Err(refusal) = refined(&model, &refusing, &noisy(&Toy { gain: 0.1 }, 7)) else { panic!("refined") };
        assert!(refusal.to_string().contains("camera_scale_change") && refusing.0.get() == PROBES, "{refusal}");
    }

    #[test]
    fn a_model_without_noise_has_no_likelihood_and_a_refinement_can_be_cancelled() {
        let (toy, mut model) = (Toy { gain: 0.1 }, model());
        let measured = noisy(&toy, 6);
        let networks = Posterior::prior(model.theta.clone());
        let mut calls = 0;
        let mut stop = |share: f64, _: usize| {
            assert!((0.0..1.0).contains(&share));
            calls += 1;
            if calls < 5 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let stopped = refine(&model, std::slice::from_ref(&measured), &networks, &settings(), &toy, &mut stop);
        assert!(matches!(stopped, Err(FitError::Cancelled)));
        model.camera.keypoint_noise_px = 0.0;
        assert!(matches!(refined(&model, &toy, &measured), Err(FitError::Noise { .. })));
    }
}
