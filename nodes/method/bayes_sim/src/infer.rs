//! Whole inference: iterations, posterior, posterior predictive check and warnings.

use crate::diagnostics::{self, Edges, Predictive, PredictiveCheck, Unchecked};
use crate::error::InferenceError;
use crate::fingerprint::fingerprint;
use crate::network::IntervalFactors;
use crate::refinement::{Refined, Refinement, refine};
use crate::sequential::{
    Iteration, Observed, OnProgress, PART, Progress, Sequential, State, SupportMove, episode_seed,
};
use crate::settings::Settings;
use crate::widening::Widening;
use catenary_core::episode::MeasuredTrack;
use catenary_core::model::DriveKind;
use catenary_core::posterior::Marginal;
use catenary_core::{Model, Policy, Posterior, SimulationRequest, Simulator, Track, seed};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use track_fit::FitError;

/// Number of draws for the share of the mixture outside of the prior's support: good to half a percentage point.
const MASS_DRAWS: usize = 10_000;
/// Random stream of the posterior predictive check, beyond those of the iterations.
const PREDICTIVE_STREAM: u64 = 101;
/// Random stream of the mass outside of the prior's support.
const MASS_STREAM: u64 = 102;

/// Result of an inference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InferenceResult {
    /// Posterior over the model's parameters, with the support of the last iteration.
    pub posterior: Posterior,
    /// Marginals of the posterior in the parameters' units.
    pub marginals: Vec<Marginal>,
    /// Widening of the networks' posterior after the last iteration. A refined posterior is not widened.
    pub widening: Widening,
    /// Account of each iteration.
    pub iterations: Vec<Iteration>,
    /// Share of the untruncated mixture outside of the prior's support, before the widening.
    pub mass_outside: f64,
    /// Refinement of the networks' posterior; none if the networks' posterior is the result.
    #[serde(default)]
    pub refinement: Option<Refinement>,
    /// Posterior predictive check; none if no draws were requested or the check was impossible.
    pub predictive: Option<Predictive>,
    /// Reason for which the posterior must not be used, if the predictive check failed outright.
    #[serde(default)]
    pub misfit: Option<String>,
    /// Reasons to doubt the result.
    pub warnings: Vec<String>,
}

impl InferenceResult {
    /// Number of simulations of the networks, without those of the refinement and of the predictive check.
    pub fn simulations(&self) -> usize {
        self.iterations.last().map_or(0, |i| i.simulations)
    }

    /// Effective sample size of the weights in the last iteration.
    pub fn effective_sample_size(&self) -> f64 {
        self.iterations.last().map_or(0.0, |i| i.effective_sample_size)
    }

    /// Moves of the prior's support in all iterations, in order.
    pub fn support_moves(&self) -> Vec<SupportMove> {
        support_moves(&self.iterations)
    }

    /// Held-out loss after each iteration, nat.
    pub fn losses(&self) -> Vec<f64> {
        self.iterations.iter().map(|i| i.loss).collect()
    }
}

/// Infers the posterior over the parameters of `model` from the episodes `measured` of one object. The parameters are equal
/// in all episodes; quantities that the model draws for each episode are not. `policy` is the policy of the episodes, needed
/// by a model that drives by policy.
///
/// The inference continues from `state` if that is complete and has the same [`fingerprint`]. Otherwise it starts over and adds
/// a warning.
///
/// # Errors
/// [`InferenceError`] with the step that failed.
pub fn infer(
    model: &Model,
    measured: &[MeasuredTrack],
    policy: Option<&Policy>,
    settings: &Settings,
    state: Option<State>,
    simulator: &dyn Simulator,
    on_progress: OnProgress<'_>,
) -> Result<InferenceResult, InferenceError> {
    in_view(measured)?;
    let observed = measured.iter().map(|m| Observed::new(model, m, policy, settings.fidelity));
    let observed = observed.collect::<Result<Vec<_>, _>>()?;
    let fingerprint = fingerprint(model, measured, policy, settings);
    let mut sequential = Sequential::new(&model.theta, observed.clone(), settings, fingerprint)?;
    let refused = state.and_then(|state| sequential.resume(state).err());
    while sequential.state().iterations().len() < settings.iterations {
        sequential.step(simulator, on_progress)?;
    }
    let iterations = sequential.state().iterations().to_vec();
    let number = iterations.len();
    let failed = |reason| InferenceError::Posterior { iteration: number, reason };
    let prior = || Posterior::prior(model.theta.clone());
    let narrow = sequential.posterior().unwrap_or_else(prior);
    let (posterior, widening) = match sequential.calibrated()? {
        None => (narrow.clone(), Widening::default()),
        Some((posterior, IntervalFactors { held_out, factors, coverage })) => {
            let width_before = narrow.marginals().map_err(failed)?.iter().map(|m| m.q95 - m.q05).collect();
            (posterior, Widening { held_out, factors, coverage_before: coverage, width_before })
        }
    };
    // A widened mixture of an undetermined parameter lies mostly outside, which says nothing about the networks.
    let mass_outside = narrow.mixture.mass_outside(MASS_DRAWS, &mut seed::rng(settings.seed, MASS_STREAM));
    let simulations = sequential.state().simulations();
    let mut unrefined = None;
    let refined = match settings.refine {
        false => None,
        true => match refined(model, measured, &posterior, settings, simulator, (simulations, on_progress))? {
            Ok(refined) => Some(refined),
            Err(reason) => {
                unrefined = Some(format!("the networks' posterior was not refined: {reason}"));
                None
            }
        },
    };
    let is_refined = refined.is_some();
    let (posterior, refinement, checked) = match refined {
        Some(Refined { posterior, refinement, predictive }) => (posterior, Some(refinement), predictive),
        None => {
            let mut tick = || match on_progress(&Progress::Working { iteration: number, simulations }) {
                ControlFlow::Continue(()) => Ok(()),
                ControlFlow::Break(()) => Err(InferenceError::Cancelled { simulations }),
            };
            let checked = checked(&posterior, (model, &observed), settings, simulator, &mut tick).transpose()?;
            (posterior, None, checked)
        }
    };
    let misfit = checked.as_ref().and_then(diagnostics::misfit);
    let incomplete = checked.as_ref().and_then(|check| match check {
        Ok(check) => check.warning(),
        Err(unchecked) => unchecked.warning(),
    });
    let predictive = checked.and_then(Result::ok).map(|check| check.figures);
    let marginals = posterior.marginals().map_err(failed)?;
    let mut warnings: Vec<String> = measured.iter().flat_map(|m| m.warnings.clone()).collect();
    warnings.extend(
        refused.map(|why| format!("the inference started over: the state of an earlier process cannot be used: {why}")),
    );
    let drive = model.observation.drive;
    if policy.is_some() && drive != DriveKind::Policy {
        warnings.push(format!("a policy was given and not used: the simulator is driven by {}", drive.name()));
    }
    let moves = support_moves(&iterations);
    warnings.extend(diagnostics::support_warnings(&moves));
    let range_of = |name: &str| simulator.range_of(name);
    // A refined mixture is mirrored at the edges, so that its mass beyond them says nothing.
    let edges = if is_refined { Edges::Inside(&posterior) } else { Edges::Beyond(&narrow) };
    warnings.extend(diagnostics::edge_warnings(edges, settings.prior_support, &range_of).map_err(failed)?);
    // A refined posterior does not rest on the networks, nor on the number of their samples.
    let networks = iterations.last().map(|i| (mass_outside, i.effective_sample_size)).filter(|_| !is_refined);
    warnings.extend(diagnostics::fit_warnings(networks, predictive.as_ref()));
    warnings.extend(unrefined);
    let rmse_mm = predictive.as_ref().map(|p| p.rmse_mm);
    warnings.extend(refinement.iter().flat_map(|refinement| refinement.warnings(rmse_mm)));
    warnings.extend(incomplete);
    Ok(InferenceResult {
        posterior,
        marginals,
        widening,
        iterations,
        mass_outside,
        refinement,
        predictive,
        misfit,
        warnings,
    })
}

/// Refuses tracks of which no keypoint is in the camera's view. Partly out of view is no error: a camera may lose an end for a
/// while. The reader of the episode warns about it.
///
/// # Errors
/// [`InferenceError::OutOfView`].
pub(crate) fn in_view(measured: &[MeasuredTrack]) -> Result<(), InferenceError> {
    let outside: usize = measured.iter().map(|m| diagnostics::out_of_view(&m.track)).sum();
    let points: usize = measured.iter().map(|m| 4 * m.track.frames.len()).sum();
    match outside == points && points > 0 {
        true => Err(InferenceError::OutOfView { points }),
        false => Ok(()),
    }
}

/// Refined posterior, or the reason why there is none.
///
/// # Errors
/// [`InferenceError::Cancelled`].
fn refined(
    model: &Model,
    measured: &[MeasuredTrack],
    networks: &Posterior,
    settings: &Settings,
    simulator: &dyn Simulator,
    (simulations, on_progress): (usize, OnProgress<'_>),
) -> Result<Result<Refined, String>, InferenceError> {
    let mut on_share =
        |share: f64, further: usize| on_progress(&Progress::Refining { share, simulations: simulations + further });
    match refine(model, measured, networks, settings, simulator, &mut on_share) {
        Ok(refined) => Ok(Ok(refined)),
        Err(FitError::Cancelled) => Err(InferenceError::Cancelled { simulations }),
        // A simulator of another maker may serve the networks and not know what a fit asks for.
        Err(reason) => Ok(Err(reason.to_string())),
    }
}

/// Posterior predictive check; none if no draws are requested. `tick` may stop it.
fn checked(
    posterior: &Posterior,
    (model, observed): (&Model, &[Observed<'_>]),
    settings: &Settings,
    simulator: &dyn Simulator,
    tick: &mut dyn FnMut() -> Result<(), InferenceError>,
) -> Option<Result<Result<PredictiveCheck, Unchecked>, InferenceError>> {
    if settings.predictive_draws == 0 {
        return None;
    }
    let failed = |reason| InferenceError::Posterior { iteration: settings.iterations, reason };
    let seed = seed::derive(settings.seed, PREDICTIVE_STREAM);
    let predicted = posterior
        .sample(settings.predictive_draws, seed)
        .map_err(failed)
        .and_then(|thetas| predictions(observed, &thetas, settings.seed, simulator, tick));
    Some(predicted.map(|predicted| diagnostics::predictive(&predicted, &model.camera.view)))
}

fn support_moves(iterations: &[Iteration]) -> Vec<SupportMove> {
    iterations.iter().flat_map(|i| i.moves.clone()).collect()
}

/// Pairs each measured track with its simulations at `thetas`. `tick` may stop the simulations between two parts.
pub(crate) fn predictions<'a>(
    observed: &[Observed<'a>],
    thetas: &[Vec<f64>],
    seed: u64,
    simulator: &dyn Simulator,
    tick: &mut dyn FnMut() -> Result<(), InferenceError>,
) -> Result<Vec<(&'a Track, Vec<Track>)>, InferenceError> {
    // Not the stream of the draws themselves: thetas and noise must be independent.
    let seed = seed::derive(seed, PREDICTIVE_STREAM + 1);
    let of = |(episode, o): (usize, &Observed<'a>)| {
        let seed = episode_seed(seed, episode);
        let mut tracks = Vec::with_capacity(thetas.len());
        for part in thetas.chunks(PART) {
            let first_episode = tracks.len() as u64;
            let request = SimulationRequest { thetas: part.to_vec(), seed, first_episode, ..o.template.clone() };
            tracks.extend(simulator.simulate(&request)?);
            tick()?;
        }
        Ok((o.track, tracks))
    };
    observed.iter().enumerate().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequential::request;
    use crate::sequential::tests::{TOY, TRUTH, quick};
    use catenary_core::mlp::Layer;
    use catenary_core::policy::Observes;
    use catenary_core::simulator::StartShape;
    use catenary_core::task::DeltaAnchor;
    use catenary_core::{Drive, GripTrajectory, Mlp, SimulatorError};
    use std::cell::RefCell;

    const SOFT_BAR: &str = include_str!("../../../../launch_configs/models/soft_bar.yaml");

    /// Linear-Gaussian toy over the model's parameters, which records its requests.
    struct Toy<'a>(&'a Model, RefCell<Vec<SimulationRequest>>);

    impl Simulator for Toy<'_> {
        fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
            self.1.borrow_mut().push(request.clone());
            let thetas = request.thetas.iter().map(|t| self.0.theta.to_unit(t)).collect();
            TOY.simulate(&SimulationRequest { thetas, ..request.clone() })
        }
    }

    fn measured() -> MeasuredTrack {
        MeasuredTrack {
            name: "toy episode".into(),
            track: TOY.track(&TRUTH, 5),
            grip: GripTrajectory::new(vec![0.0, 1.0], vec![Default::default(); 2]).unwrap(),
            actions: Vec::new(),
            start: StartShape::HangingAtRest,
            target_m: Some([0.5, 0.1]),
            warnings: vec!["the recording is doubtful".into()],
        }
    }

    #[test]
    fn a_whole_inference_simulates_trains_and_checks_itself() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let settings = Settings { iterations: 2, predictive_draws: 25, ..quick() };
        let simulator = Toy(&model, RefCell::default());
        let mut listen = |_: &crate::sequential::Progress<'_>| ControlFlow::Continue(());
        let result = infer(&model, &[measured()], None, &settings, None, &simulator, &mut listen).unwrap();
        let asked = simulator.1.into_inner();
        assert_eq!(asked.iter().map(|r| r.thetas.len()).collect::<Vec<_>>(), [40, 40, 25]);
        let times: Vec<f64> = measured().track.frames.iter().map(|f| f.time_s).collect();
        for request in &asked {
            assert_eq!((&request.drive, &request.frame_times_s), (&Drive::Grip(measured().grip), &times));
            assert_eq!((request.target_m, request.noise), (Some([0.5, 0.1]), true));
            assert!(asked.iter().filter(|r| r.seed == request.seed).count() == 1, "a seed came twice");
        }
        assert_eq!((result.simulations(), result.losses().len()), (80, 2));
        assert_eq!(result.effective_sample_size(), result.iterations[1].effective_sample_size);
        assert_eq!(result.marginals, result.posterior.marginals().unwrap());
        let Widening { held_out, factors, coverage_before, width_before } = &result.widening;
        // Two networks hold out a fifth of at most 80 tracks each.
        assert!((2..=60).contains(held_out) && factors.len() == 2 && width_before.len() == 2, "{:?}", result.widening);
        assert!(factors.iter().all(|f| *f >= 1.0) && coverage_before.iter().all(|c| (0.0..=1.0).contains(c)));
        for (m, before) in result.marginals.iter().zip(width_before) {
            assert!(m.q95 - m.q05 > 0.99 * before, "{m:?} was {before} wide");
        }
        assert_eq!(result.predictive.as_ref().map(|p| p.draws), Some(25));
        assert!((0.0..1.0).contains(&result.mass_outside), "{}", result.mass_outside);
        // 80 simulations are under the 100 effective ones that a posterior should rest on.
        assert!(result.warnings.iter().any(|w| w.contains("effective samples")), "{:?}", result.warnings);
        assert_eq!(result.warnings[0], measured().warnings[0], "what is doubtful about the track comes along");
        let back: InferenceResult = serde_json::from_str(&serde_json::to_string(&result).unwrap()).unwrap();
        // JSON may lose the last bit of a number.
        let density = |r: &InferenceResult| r.posterior.log_density_unit(&[0.25, 1e4]);
        assert!((density(&back) - density(&result)).abs() < 1e-9, "{} against {}", density(&back), density(&result));
        assert_eq!((back.warnings, back.iterations.len()), (result.warnings, 2));
    }

    #[test]
    fn a_state_that_does_not_fit_is_ignored_with_a_warning() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let settings = Settings { iterations: 1, predictive_draws: 0, ..quick() };
        let asked = fingerprint(&model, &[measured()], None, &settings);
        // The measured track has six frames.
        let state = State::new(asked, crate::network::Samples::new(3, 2));
        let simulator = Toy(&model, RefCell::default());
        let mut listen = |_: &crate::sequential::Progress<'_>| ControlFlow::Continue(());
        let result = infer(&model, &[measured()], None, &settings, Some(state), &simulator, &mut listen).unwrap();
        assert_eq!(result.iterations.len(), 1);
        let said = result.warnings.iter().find(|w| w.starts_with("the inference started over")).unwrap();
        assert!(said.contains("samples: expected whole tracks of 6 frames"), "{said}");
    }

    #[test]
    fn a_track_out_of_view_is_refused_and_one_partly_out_of_view_is_used() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let settings = Settings { iterations: 1, predictive_draws: 0, ..quick() };
        let outcome = |shift: f64, frames: usize| {
            let mut measured = measured();
            for frame in &mut measured.track.frames[..frames] {
                frame.dlo.iter_mut().for_each(|[x, _]| *x += shift);
            }
            let simulator = Toy(&model, RefCell::default());
            let mut listen = |_: &crate::sequential::Progress<'_>| ControlFlow::Continue(());
            let result = infer(&model, &[measured], None, &settings, None, &simulator, &mut listen);
            result.map(|r| r.iterations.len()).map_err(|e| e.to_string())
        };
        let frames = measured().track.frames.len();
        let words = outcome(200.0, frames).unwrap_err();
        assert!(words.contains(&format!("got all {} outside of it", 4 * frames)), "{words}");
        assert_eq!((outcome(3.0, 1), outcome(0.0, 0)), (Ok(1), Ok(1)));
    }

    #[test]
    fn no_predictive_draws_means_no_check() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let settings = Settings { iterations: 1, predictive_draws: 0, ..quick() };
        let simulator = Toy(&model, RefCell::default());
        let mut listen = |_: &crate::sequential::Progress<'_>| ControlFlow::Continue(());
        let result = infer(&model, &[measured()], None, &settings, None, &simulator, &mut listen).unwrap();
        assert_eq!((result.predictive, simulator.1.borrow().len()), (None, 1));
    }

    #[test]
    fn the_check_of_the_posterior_can_be_cancelled_between_parts() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let settings = Settings { iterations: 1, predictive_draws: 3 * PART, ..quick() };
        let simulator = Toy(&model, RefCell::default());
        let (mut is_over, mut parts) = (false, 0);
        let mut listen = |progress: &crate::sequential::Progress<'_>| {
            parts += usize::from(is_over);
            is_over |= matches!(progress, Progress::Iteration { .. });
            if parts == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let error = infer(&model, &[measured()], None, &settings, None, &simulator, &mut listen).unwrap_err();
        assert!(matches!(error, InferenceError::Cancelled { simulations: 40 }), "{error}");
        assert_eq!(simulator.1.borrow().len(), 1 + 2, "batches");
    }

    #[test]
    fn an_unused_policy_gets_a_warning() {
        let model = Model::from_yaml(SOFT_BAR).unwrap();
        let settings = Settings { iterations: 1, predictive_draws: 0, ..quick() };
        let warned = |policy: Option<&Policy>| {
            let mut listen = |_: &crate::sequential::Progress<'_>| ControlFlow::Continue(());
            let simulator = Toy(&model, RefCell::default());
            let result = infer(&model, &[measured()], policy, &settings, None, &simulator, &mut listen).unwrap();
            result.warnings.iter().any(|w| w.contains("policy was given and not used") && w.contains("grip"))
        };
        let layer = Layer { inputs: 12, outputs: 2, weight: vec![0.0; 24], bias: vec![0.0; 2] };
        let policy = Policy {
            name: "still".into(),
            actor: Mlp::new(vec![layer]).unwrap(),
            observes: Observes::default(),
            plan: None,
            observation_mean: [0.0; 12],
            observation_scale: [1.0; 12],
            action_scale: [1.0; 2],
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            steps: 16,
            goal: None,
            arm: None,
            start_speed_m_s: None,
        };
        assert!(warned(Some(&policy)) && !warned(None));
    }

    #[test]
    fn a_missing_drive_is_named() {
        let mut model = Model::from_yaml(SOFT_BAR).unwrap();
        let mut refusal = |drive| {
            model.observation.drive = drive;
            request(&model, &measured(), None, catenary_core::Fidelity::Fast).unwrap_err().to_string()
        };
        let words = "the model drives the simulator by actions: expected the episode's actions, got none";
        assert_eq!(refusal(DriveKind::Actions), words);
        let words = "the model drives the simulator by policy: expected the policy that the episode ran, got none";
        assert_eq!(refusal(DriveKind::Policy), words);
        let acted = MeasuredTrack { actions: vec![[0.0; 2]; 16], ..measured() };
        model.observation.drive = DriveKind::Actions;
        let (asked, frames) = request(&model, &acted, None, catenary_core::Fidelity::Fast).unwrap();
        assert_eq!((asked.drive, frames), (Drive::Actions(acted.actions), 17));
    }
}
