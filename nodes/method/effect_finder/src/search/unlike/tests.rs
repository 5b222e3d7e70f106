//! Tests of unlike episodes with a toy in which an unknown acts only in some episodes.

use super::*;
use crate::report::{Finding, Verdict};
use crate::search::{Progress, Question, find};
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::{SimulatorError, TrackSensitivities};
use catenary_core::{DifferentiableSimulator, SimulationRequest, Simulator, Track, seed};
use std::ops::ControlFlow;
use track_fit::toy::{self, Toy};

const MASS: &str = "tip_mass_kg";
const STIFFNESS: &str = "youngs_modulus_pa";
const TOY: Toy = Toy { gain: 3.0 };

/// Toy in which one unknown acts only in episodes with a target.
struct Touching {
    unknown: &'static str,
    /// Stiffness under which it moves keypoints of these episodes the other way, so that fits are led away from higher ones.
    turns_under_pa: f64,
}

const WALL: Touching = Touching { unknown: MASS, turns_under_pa: 0.0 };
const SOFT: Touching = Touching { unknown: STIFFNESS, turns_under_pa: 0.0 };

impl Touching {
    /// Request of the plain toy that gives the tracks of `request`.
    fn plain(&self, request: &SimulationRequest) -> SimulationRequest {
        let mut plain = request.clone();
        if request.target_m.is_some() {
            plain.thetas.iter_mut().filter(|theta| self.turns(theta)).for_each(|theta| theta[1] *= -1.0);
        } else if self.unknown == STIFFNESS {
            plain.thetas.iter_mut().for_each(|theta| theta[1] = 0.0);
        } else {
            plain.effects.retain(|(name, _)| *name != self.unknown);
        }
        plain
    }

    fn turns(&self, theta: &[f64]) -> bool {
        theta[1] < self.turns_under_pa
    }
}

impl Simulator for Touching {
    fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
        TOY.simulate(&self.plain(request))
    }
}

impl DifferentiableSimulator for Touching {
    fn sensitivities(
        &self,
        request: &SimulationRequest,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let mut all = TOY.sensitivities(&self.plain(request), names)?;
        let Some(place) = names.iter().position(|n| *n == self.unknown) else { return Ok(all) };
        for (one, theta) in all.iter_mut().zip(&request.thetas) {
            let factor = match (request.target_m, self.turns(theta)) {
                (None, _) => 0.0,
                (Some(_), true) => -1.0,
                (Some(_), false) => 1.0,
            };
            let values = one.derivatives[place].iter_mut().flat_map(|by| by.dlo.iter_mut().flatten());
            values.for_each(|value| *value *= factor);
        }
        Ok(all)
    }
}

/// Noisy episode number `number`, which touches something if it has a target.
fn measured(simulator: &Touching, number: u64, length_m: f64, mass: f64, touches: bool) -> MeasuredTrack {
    let target_m = touches.then_some([0.5, 0.1]);
    let mut episode = toy::episode(&TOY, [length_m, 2e4], &[]);
    let request = SimulationRequest {
        thetas: vec![vec![length_m, 2e4]],
        effects: vec![(MASS.to_owned(), vec![mass])],
        target_m,
        ..episode.template.clone()
    };
    episode.measured = simulator.simulate(&request).unwrap().remove(0);
    let track = episode.measured_anew(&mut seed::rng(51, number)).measured;
    MeasuredTrack { name: format!("episode {number}"), track, target_m, ..toy::measured(&TOY, [length_m, 2e4], &[]) }
}

/// Search in these episodes. Its progress must not fall.
fn found(simulator: &Touching, [measured, validation, held_out]: [&[MeasuredTrack]; 3]) -> Finding {
    let (model, candidates) = (toy::model(), [MASS, "linear_drag_n_s_m2"].map(toy::candidate));
    let question = Question { validation, held_out, candidates: &candidates, ..Question::of(&model, measured) };
    let mut last = 0.0;
    let mut listen = |told: &Progress| {
        assert!(told.progress >= last && told.progress <= 1.0, "{told:?} after {last}");
        last = told.progress;
        ControlFlow::Continue(())
    };
    find(question, simulator, &settings(), &mut listen).unwrap().finding
}

fn settings() -> Settings {
    Settings { finer_fidelity: None, draws: 40, starts: 2, null_sets: 99, ..Settings::default() }
}

fn kinds(finding: &Finding) -> Vec<(&str, bool, usize)> {
    finding.joined.iter().map(|test| (test.name.as_str(), test.is_held_out, test.index)).collect()
}

#[test]
fn episodes_that_contradict_the_model_are_searched_as_if_given_as_fitted() {
    let [free, first, second] =
        [(1, false), (2, true), (3, true)].map(|(number, touches)| measured(&WALL, number, 0.25, 0.05, touches));
    let given = found(&WALL, [&[free.clone(), first.clone(), second.clone()], &[], &[]]);
    assert_eq!((given.verdict, given.found.clone()), (Verdict::Named, vec![vec![MASS.to_owned()]]));
    let moved = found(&WALL, [&[free], &[first], &[second]]);
    assert_eq!(kinds(&moved), [("episode 2", false, 0), ("episode 3", true, 0)]);
    let (before, since) = moved.conclusions.split_at(moved.conclusions.len() - given.conclusions.len());
    let least = "p <= 0.01 (99 null data sets)";
    let told = format!(
        "2 other episodes contradict the model: episode 2, {least}, and episode 3, {least}; the search goes on with \
         them among the fitted episodes; episode 3 is no longer held out, and cannot verify the result"
    );
    assert_eq!((before.last(), since), (Some(&told), given.conclusions.as_slice()));
    assert_eq!(Finding { joined: Vec::new(), conclusions: given.conclusions.clone(), ..moved }, given);
}

#[test]
fn episodes_that_agree_stay_for_validation() {
    let [free, other, touching] =
        [(1, false), (6, false), (2, true)].map(|(number, touches)| measured(&WALL, number, 0.25, 0.05, touches));
    let among = found(&WALL, [std::slice::from_ref(&free), &[other.clone(), touching.clone()], &[]]);
    let held_out = found(&WALL, [&[free], &[other], &[touching]]);
    for (finding, kind) in [(among, ("episode 2", false, 1)), (held_out, ("episode 2", true, 0))] {
        assert_eq!((finding.verdict, kinds(&finding)), (Verdict::Named, vec![kind]), "{:?}", finding.conclusions);
        assert!(finding.verification.is_some_and(|v| v.selects && v.episodes == 1), "{:?}", finding.conclusions);
    }
}

/// The effect does not act in the validation episode, whose distances differ from the noise floor by chance alone.
#[test]
fn validation_episodes_without_a_gap_say_nothing_of_a_repair() {
    for number in 6..12 {
        let [first, second, touching, other] = [(1, false), (3, false), (2, true), (number, false)]
            .map(|(number, touches)| measured(&WALL, number, 0.25, 0.003, touches));
        let finding = found(&WALL, [&[first, second, touching], &[other], &[]]);
        assert_eq!(finding.verdict, Verdict::Named, "{number}: {:?}", finding.conclusions);
        let verification = finding.verification.unwrap();
        assert_eq!(verification.closed(), None, "{number}: {verification:?}");
    }
}

#[test]
fn no_gap_tells_that_the_further_episodes_agree() {
    let [free, second, third] = [1, 6, 7].map(|number| measured(&WALL, number, 0.25, 0.05, false));
    for (validation, held_out, told) in [
        (vec![second.clone()], vec![third], "the 2 further episodes agree with the model, too: the least p = 0."),
        (vec![second], vec![], "the further episode agrees with the model, too: p = 0."),
    ] {
        let finding = found(&WALL, [std::slice::from_ref(&free), &validation, &held_out]);
        assert_eq!((finding.verdict, finding.joined.len()), (Verdict::NoGap, 0), "{:?}", finding.conclusions);
        assert!(finding.conclusions.iter().any(|s| s.starts_with(told)), "{:?}", finding.conclusions);
    }
}

#[test]
fn episodes_of_objects_of_different_length_are_a_gap() {
    let [short, long] = [(1, 0.25), (6, 0.26)].map(|(number, length_m)| measured(&WALL, number, length_m, 0.0, false));
    assert_eq!(found(&WALL, [std::slice::from_ref(&short), &[], &[]]).verdict, Verdict::NoGap);
    let finding = found(&WALL, [&[short], &[long], &[]]);
    assert_eq!(kinds(&finding), [("episode 6", false, 0)]);
    assert_eq!(finding.verdict, Verdict::NoneOfThese, "{:?}", finding.conclusions);
}

/// The fitted episode says nothing of the stiffness, whose fit is far from what the other episode needs; near
/// that fit the other episode may lead away from it.
#[test]
fn an_episode_may_determine_what_the_fitted_ones_leave_open() {
    for soft in [SOFT, Touching { turns_under_pa: 1.5e4, ..SOFT }] {
        let [fitted, other] =
            [(1, false), (7, true)].map(|(number, touches)| measured(&soft, number, 0.25, 0.0, touches));
        let finding = found(&soft, [&[fitted], &[other], &[]]);
        let stiffness = &finding.present.estimates[1];
        assert!(stiffness.value < 1e4, "{stiffness:?}: the test would test nothing");
        assert_eq!((finding.verdict, finding.joined.len()), (Verdict::NoGap, 0), "{:?}", finding.conclusions);
    }
}

#[test]
fn the_tests_of_further_episodes_can_be_cancelled() {
    let model = toy::model();
    let [fitted, validation] = [1, 6].map(|number| [measured(&WALL, number, 0.25, 0.0, false)]);
    let question = Question { validation: &validation, ..Question::of(&model, &fitted) };
    for rounds in 1..6 {
        let mut left = None;
        let mut listen = |told: &Progress| {
            let is_tested = told.conclusion.as_ref().is_some_and(|c| c.starts_with("the residual is noise"));
            left = if is_tested { Some(rounds) } else { left.map(|left| left - 1) };
            if left == Some(0) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let ended = find(question, &WALL, &settings(), &mut listen);
        assert!(matches!(ended, Err(FinderError::Cancelled("detect"))), "{rounds}: {ended:?}");
    }
}

#[test]
fn a_further_episode_appends_its_own_unknowns() {
    let mut model = toy::model();
    model.camera.position_jitter_m = 0.01;
    let unknowns = Unknowns::of(&model, 2);
    let point: Vec<f64> = (0..unknowns.columns()).map(|i| 0.01 * i as f64).collect();
    let own: Vec<f64> = (0..unknowns.for_episodes(1).columns()).map(|i| 0.5 + 0.01 * i as f64).collect();
    let (all, joint) = (unknowns.for_episodes(3), appended(&unknowns, &point, &own));
    let values = |episode| all.values(&joint, episode);
    assert_eq!([values(0), values(1)], [0, 1].map(|episode| unknowns.values(&point, episode)));
    let theta = unknowns.theta();
    assert!(all.list().len() > theta && joint.len() == all.columns());
    assert_eq!(values(2)[..theta], values(0)[..theta]);
    assert_eq!(values(2)[theta..], unknowns.for_episodes(1).values(&own, 0)[theta..]);
}
