//! Behaviour of the sequential inference. The submodules test that its posteriors are right.

mod calibration;
mod classifier;
pub(crate) mod linear_gaussian;
mod random_runs;
mod support;

use super::*;
use crate::embedding::{Embedding, Fourier};
use crate::settings::ProposalKind;
use catenary_core::simulator::StartShape;
use catenary_core::track::End;
use catenary_core::{Drive, Fidelity, Frame, Parameter, Prior, SimulatorError};
use linear_gaussian::{FRAMES, LinearGaussian};
use rand::RngExt;
use rand_distr::StandardNormal;
use std::cell::Cell;
use std::ops::ControlFlow;

pub(crate) const TOY: LinearGaussian = LinearGaussian { dimension: 2, noise: 0.15, mirrored: 0.0, rigid: false };
pub(crate) const TRUTH: [f64; 2] = [0.4, 0.7];

fn template() -> SimulationRequest {
    SimulationRequest {
        thetas: vec![],
        effects: vec![],
        drive: Drive::Actions(vec![]),
        start: StartShape::HangingAtRest,
        frame_times_s: vec![],
        target_m: None,
        fidelity: Fidelity::Standard,
        seed: 0,
        first_episode: 0,
        noise: true,
    }
}

/// Observation of one episode with at most `frames` frames.
pub(crate) fn seen(track: &Track, frames: usize) -> Vec<Observed<'_>> {
    vec![Observed { track, template: template(), frames }]
}

/// Posterior of the networks of `sequential` at another track.
fn posterior_at(sequential: &mut Sequential<'_>, track: &Track) -> Posterior {
    sequential.observed = TrackInput::new(track, FRAMES).unwrap();
    Posterior { parameters: sequential.space.clone(), mixture: sequential.mixture().unwrap() }
}

/// Runs all iterations. Returns the account and the posterior of the last one.
fn run(
    sequential: &mut Sequential<'_>,
    simulator: &dyn Simulator,
    iterations: usize,
) -> Result<(Iteration, Posterior), InferenceError> {
    let mut step = || sequential.step(simulator, &mut |_| ControlFlow::Continue(()));
    let mut last = step()?;
    for _ in 1..iterations {
        last = step()?;
    }
    Ok(last)
}

/// Small settings for quick tests; their posteriors are poor.
pub(crate) fn quick() -> Settings {
    Settings {
        simulations: 40,
        embedding: Embedding { frequencies: 6, fourier: Fourier::CosOnly },
        projection: Some(8),
        hidden: vec![10],
        components: 2,
        ensemble: 2,
        refine: false,
        schedule: crate::settings::Schedule { max_epochs: 4, ..Settings::default().schedule },
        ..Settings::default()
    }
}

/// Quick inference with `simulator`.
fn quick_run(
    settings: &Settings,
    simulator: &dyn Simulator,
    iterations: usize,
) -> Result<(Iteration, Posterior), InferenceError> {
    let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
    run(&mut Sequential::new(&space, seen(&observed, FRAMES), settings, 0)?, simulator, iterations)
}

/// Simulator from a function.
struct Simulate<F>(F);

impl<F: Fn(&SimulationRequest) -> Result<Vec<Track>, SimulatorError>> Simulator for Simulate<F> {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        (self.0)(request)
    }
}

/// Toy simulator whose tracks are changed by `change` (index, theta, track).
fn changed(change: impl Fn(usize, &[f64], &mut Track)) -> impl Simulator {
    Simulate(move |request: &SimulationRequest| {
        let mut tracks = TOY.simulate(request)?;
        tracks.iter_mut().enumerate().for_each(|(i, t)| change(i, &request.thetas[i], t));
        Ok(tracks)
    })
}

#[test]
fn equal_seeds_give_equal_bits_and_different_seeds_different_posteriors() {
    for proposal in [Settings::default().proposal, ProposalKind::Posterior { prior_share: 0.2 }] {
        let settings = Settings { proposal, ..quick() };
        let first = quick_run(&settings, &TOY, 3).unwrap();
        assert_eq!(quick_run(&settings, &TOY, 3).unwrap(), first);
        let other = quick_run(&Settings { seed: 1, ..settings }, &TOY, 3).unwrap();
        assert_ne!(other.1.mixture, first.1.mixture);
    }
}

#[test]
fn the_order_of_keypoints_does_not_change_a_bit() {
    let settings = quick();
    let turned = changed(|i, _, track| track.frames.iter_mut().for_each(|f| f.dlo.rotate_left(i % 4)));
    assert_eq!(quick_run(&settings, &turned, 2).unwrap(), quick_run(&settings, &TOY, 2).unwrap());
}

#[test]
fn an_iteration_accounts_for_what_it_did() {
    let settings = quick();
    let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
    let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap();
    let (mut epochs, mut told) = (0, Vec::new());
    let mut least_volume = 1.0;
    for number in 1..=3 {
        let (iteration, posterior) = sequential
            .step(&TOY, &mut |progress| {
                match progress {
                    Progress::Working { .. } | Progress::Refining { .. } => {}
                    Progress::Epoch { iteration, .. } => epochs += usize::from(*iteration == number),
                    Progress::Iteration { iteration, of, posterior, .. } => {
                        told.push(((*iteration).clone(), *of, (*posterior).clone()));
                    }
                }
                ControlFlow::Continue(())
            })
            .unwrap();
        assert_eq!((iteration.iteration, iteration.simulations, iteration.unusable), (number, 40 * number, 0));
        assert_eq!(iteration.epochs, epochs);
        assert_eq!(told.last(), Some(&(iteration.clone(), settings.iterations, posterior)));
        assert!(iteration.proposal_volume <= 1.0 && iteration.proposal_volume >= 0.25 * least_volume, "{iteration:?}");
        assert!(iteration.effective_sample_size <= iteration.tracks as f64 + 1e-9, "{iteration:?}");
        assert!(iteration.tracks <= iteration.simulations && iteration.loss.is_finite(), "{iteration:?}");
        least_volume = iteration.proposal_volume;
        epochs = 0;
    }
    assert_eq!((sequential.samples().len(), sequential.networks().len()), (120, 2));
}

#[test]
fn the_simulator_is_asked_for_thetas_of_the_prior_in_their_units_and_never_twice_with_one_seed() {
    let range = Parameter { name: "youngs_modulus_pa".into(), prior: Prior::LogUniform { low: 1e3, high: 5e4 } };
    let space = ParameterSpace::new(vec![range]).unwrap();
    let (settings, observed) = (quick(), TOY.track(&TRUTH, 5));
    let seeds = std::cell::RefCell::new(Vec::new());
    let asked = Simulate(|request: &SimulationRequest| {
        seeds.borrow_mut().push(request.seed);
        assert!(request.thetas.iter().all(|t| (1e3..=5e4).contains(&t[0])), "{:?}", request.thetas);
        let below = request.thetas.iter().filter(|t| t[0] < 50_f64.sqrt() * 1e3).count();
        // Half of the prior lies below its geometric mean; 40 draws, four standard deviations of 3.2.
        assert!(seeds.borrow().len() > 1 || below.abs_diff(20) < 13, "{below} of 40");
        let unit = |t: &Vec<f64>| vec![space.to_unit(t)[0], 0.5];
        TOY.simulate(&SimulationRequest { thetas: request.thetas.iter().map(unit).collect(), ..request.clone() })
    });
    let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap();
    run(&mut sequential, &asked, 2).unwrap();
    assert!(seeds.borrow().len() == 2 && seeds.borrow()[0] != seeds.borrow()[1]);
}

#[test]
fn cancelling_stops_at_once_and_says_after_how_many_simulations() {
    let (space, observed, settings) = (TOY.space(), TOY.track(&TRUTH, 5), quick());
    type At = fn(&Progress<'_>) -> bool;
    let cases: [(At, usize); 2] = [
        (|p| matches!(p, Progress::Epoch { .. }), 1),
        // Two networks of four passes, and the iteration itself.
        (|p| matches!(p, Progress::Iteration { .. }), 9),
    ];
    for (at, heard_before) in cases {
        let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap();
        let (heard, mut second) = (Cell::new(0), false);
        let mut outcome = Ok(());
        while outcome.is_ok() {
            let mut listen = |progress: &Progress<'_>| {
                heard.set(heard.get() + usize::from(second && !matches!(progress, Progress::Working { .. })));
                if second && at(progress) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            outcome = sequential.step(&TOY, &mut listen).map(drop);
            second = true;
        }
        let error = outcome.unwrap_err();
        assert!(matches!(error, InferenceError::Cancelled { simulations: 80 }), "{error:?}");
        assert_eq!(error.to_string(), "inference was cancelled after 80 simulations");
        assert_eq!(heard.get(), heard_before);
    }
}

#[test]
fn an_iteration_can_be_cancelled_between_parts_of_its_simulations_and_between_batches() {
    let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
    let settings = Settings { simulations: 300, ..quick() };
    // Five parts of the simulations, then batches of 50 tracks.
    for (stop_at, simulations) in [(1, 64), (2, 128), (5, 300), (7, 300)] {
        let (asked, heard, passes) = (Cell::new(0), Cell::new(0), Cell::new(0));
        let counted = Simulate(|request: &SimulationRequest| {
            asked.set(asked.get() + request.thetas.len());
            TOY.simulate(request)
        });
        let mut listen = |progress: &Progress<'_>| {
            heard.set(heard.get() + 1);
            passes.set(passes.get() + usize::from(!matches!(progress, Progress::Working { .. })));
            if heard.get() == stop_at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap();
        let error = sequential.step(&counted, &mut listen).unwrap_err();
        let InferenceError::Cancelled { simulations: told } = error else { panic!("{error:?}") };
        assert_eq!((told, asked.get(), heard.get(), passes.get()), (simulations, simulations, stop_at, 0));
    }
}

#[test]
fn a_round_that_is_simulated_in_parts_gives_the_tracks_of_the_whole() {
    let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
    let settings = Settings { simulations: 150, ..quick() };
    let whole = SimulationRequest {
        thetas: (0..150).map(|i| vec![f64::from(i) / 150.0, 0.5]).collect(),
        effects: vec![("tip_mass_kg".into(), (0..150).map(f64::from).collect())],
        seed: 9,
        ..template()
    };
    let parts: Vec<Track> = [0..64, 64..128, 128..150].map(|r| TOY.simulate(&whole.part(r)).unwrap()).concat();
    assert_eq!(parts, TOY.simulate(&whole).unwrap());
    assert_eq!(whole.part(64..128).effects[0].1[..2], [64.0, 65.0]);
    let episodes = std::cell::RefCell::new(Vec::new());
    let noted = Simulate(|r: &SimulationRequest| {
        episodes.borrow_mut().push((r.seed, r.first_episode, r.thetas.len()));
        TOY.simulate(r)
    });
    run(&mut Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap(), &noted, 1).unwrap();
    let asked = episodes.into_inner();
    assert_eq!(asked.iter().map(|(_, first, n)| (*first, *n)).collect::<Vec<_>>(), [(0, 64), (64, 64), (128, 22)]);
    assert!(asked.iter().all(|(seed, ..)| *seed == asked[0].0));
}

#[test]
fn every_theta_is_simulated_in_every_episode_and_one_unusable_track_spoils_it() {
    let (first, second) = (TOY.track(&TRUTH, 5), TOY.track(&TRUTH, 6));
    let (space, settings) = (TOY.space(), quick());
    let asked = std::cell::RefCell::new(Vec::new());
    let noted = Simulate(|r: &SimulationRequest| {
        let mut tracks = TOY.simulate(r)?;
        // Unusable: the second theta's track of the first episode and the first theta's track of the second.
        tracks[usize::from(asked.borrow().is_empty())].frames.clear();
        asked.borrow_mut().push((r.thetas.clone(), r.seed, r.target_m));
        Ok(tracks)
    });
    let mut observed = [&first, &second].map(|t| seen(t, FRAMES)).concat();
    observed[1].template.target_m = Some([0.5, 0.1]);
    let mut sequential = Sequential::new(&space, observed, &settings, 0).unwrap();
    let (iteration, _) = run(&mut sequential, &noted, 1).unwrap();
    assert_eq!((iteration.simulations, iteration.unusable, iteration.tracks), (40, 2, 38));
    assert_eq!(sequential.observed().frames(), 2 * FRAMES);
    let asked = asked.into_inner();
    assert_eq!((&asked[0].0, asked.len()), (&asked[1].0, 2));
    assert_ne!(asked[0].1, asked[1].1, "the episodes' noise is not the same");
    assert_eq!((asked[0].2, asked[1].2), (None, Some([0.5, 0.1])));
}

#[test]
fn failures_of_the_simulator_are_errors_with_expected_and_received_numbers() {
    let words = |simulator: &dyn Simulator| quick_run(&quick(), simulator, 1).unwrap_err().to_string();
    let failing = Simulate(|_: &SimulationRequest| Err(SimulatorError::Backend("worker 3 is gone".into())));
    assert_eq!(words(&failing), "simulator: worker 3 is gone");
    let short = Simulate(|r: &SimulationRequest| TOY.simulate(r).map(|t| t[1..].to_vec()));
    assert_eq!(words(&short), "simulator: expected 40 tracks, got 39");
    let few = changed(|i, _, track| track.frames[2].dlo[1][0] = if i < 9 { 0.0 } else { f64::NAN });
    let expected = "iteration 1: expected at least 10 usable tracks to train on, got 9; the last refused one: track: \
                    frame 2 (at 0.2 s) holds a number that is not finite";
    assert_eq!(words(&few), expected);
    let none = changed(|_, _, track| track.frames.clear());
    assert!(
        words(&none).ends_with("got 0; the last refused one: track: expected 1 to 6 frames, got 0"),
        "{}",
        words(&none)
    );
}

#[test]
fn unusable_observations_and_settings_are_refused_at_once() {
    let (space, settings) = (TOY.space(), quick());
    let mut observed = TOY.track(&TRUTH, 5);
    let refusal = |observed: &Track, frames, settings: &Settings| {
        Sequential::new(&space, seen(observed, frames), settings, 0).err().unwrap().to_string()
    };
    assert_eq!(refusal(&observed, 5, &settings), "the measured track: expected 1 to 5 frames, got 6");
    let bad = Settings { ensemble: 0, ..quick() };
    assert_eq!(refusal(&observed, 6, &bad), "settings: `ensemble`: expected at least 1, got 0");
    observed.frames[1].eef[0] = f64::NAN;
    let words = "the measured track: frame 1 (at 0.1 s) holds a number that is not finite";
    assert_eq!(refusal(&observed, 6, &settings), words);
}

#[test]
fn unusable_tracks_are_left_out_without_bias() {
    // Tracks of the right half are unusable: the first proposal covers that half, the second one hardly.
    let half = changed(|_, theta, track| {
        if theta[0] > 0.5 {
            track.frames.clear()
        }
    });
    let settings = Settings { simulations: 400, proposal: ProposalKind::Posterior { prior_share: 0.1 }, ..quick() };
    let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
    let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap();
    let (iteration, _) = run(&mut sequential, &half, 2).unwrap();
    assert_eq!(iteration.simulations - iteration.unusable, iteration.tracks);
    assert!((250..650).contains(&iteration.tracks), "{iteration:?}");
    assert!(sequential.proposals.iter().all(|p| p.count() == 400), "unusable draws count as draws");
    assert!(iteration.effective_sample_size < 0.97 * iteration.tracks as f64, "weights are all alike: {iteration:?}");
    let samples = sequential.samples();
    let weights = balance_weights((0..samples.len()).map(|i| samples.theta(i)), &sequential.proposals);
    // The sum of the weights over the number of draws estimates the usable share of the prior, one half.
    let share = weights.iter().sum::<f64>() / iteration.simulations as f64;
    let squares = weights.iter().map(|w| w * w).sum::<f64>() / iteration.simulations as f64;
    let error = ((squares - share * share) / iteration.simulations as f64).sqrt();
    assert!((share - 0.5).abs() < 4.0 * error, "{share} +- {error}");
}

#[test]
fn the_length_of_a_track_alone_determines_theta() {
    // All keypoints are equal; an episode of the right half ends early.
    let still = changed(|_, theta, track| {
        let frame = track.frames[0];
        track.frames =
            vec![Frame { dlo: [[0.0; 2]; 4], time_s: 0.0, ..frame }; if theta[0] > 0.5 { 3 } else { FRAMES }];
    });
    let mut schedule = quick().schedule;
    schedule.max_epochs = 60;
    let settings = Settings { simulations: 300, ensemble: 1, schedule, ..quick() };
    let space = TOY.space();
    let mean = |frames: usize| {
        let mut observed = TOY.track(&TRUTH, 5);
        observed.frames = vec![Frame { dlo: [[0.0; 2]; 4], ..observed.frames[0] }; frames];
        let mut sequential = Sequential::new(&space, seen(&observed, FRAMES), &settings, 0).unwrap();
        run(&mut sequential, &still, 1).unwrap().1.marginals().unwrap()[0].mean
    };
    let (early, whole) = (mean(3), mean(FRAMES));
    assert!((early - 0.75).abs() < 0.08 && (whole - 0.25).abs() < 0.08, "{early}, {whole}");
}

#[test]
fn a_training_that_fails_says_so_and_where() {
    let mut settings = quick();
    settings.schedule.learning_rate = 1e30;
    settings.schedule.max_gradient_norm = 1e30;
    let error = quick_run(&settings, &TOY, 1).unwrap_err();
    assert!(matches!(error, InferenceError::Training { iteration: 1, .. }), "{error:?}");
    assert!(error.to_string().starts_with("iteration 1: training failed in epoch 1: the "), "{error}");
}
