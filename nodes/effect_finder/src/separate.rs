//! The motion that would tell two explanations apart.
//!
//! Random motions inside the task's workspace are simulated under both; the one is best under which the second, whatever
//! values its unknowns take, differs most from the first in standard deviations of the noise.

use crate::case::Case;
use crate::error::FinderError;
use crate::fit::{OnRound, Problem, Start};
use crate::hypothesis::Hypothesis;
use crate::settings::Settings;
use catenary_core::task::MAX_DELTA_M;
use catenary_core::{Model, Task, Track, seed};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// Random stream of the motions.
const STREAM: u64 = 2101;
/// Motions that are tried.
const MOTIONS: usize = 48;

/// A motion that tells two explanations apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Separation {
    /// The two, by the names of their effects.
    pub between: [String; 2],
    /// Actions (dx, dz) in m, one a step of the task.
    pub actions: Vec<[f64; 2]>,
    /// Squared deviations, in variances of the noise, that the second would leave of an episode in which the first is true.
    pub deviations: f64,
    /// The same, of the motion that is the middle one among those tried.
    pub usual_deviations: f64,
}

/// Squared deviations under which a motion tells nothing apart: three standard deviations of one coordinate.
const LEAST_DEVIATIONS: f64 = 9.0;

impl Separation {
    /// Whether the motion tells them apart.
    pub fn tells(&self) -> bool {
        self.deviations >= LEAST_DEVIATIONS
    }
}

/// Looks for the motion under which `second` differs most from `first`; none where the model has no task, which says what a
/// motion may be, or no motion can be simulated.
///
/// # Errors
/// [`FinderError::Cancelled`] where `on_round` asked to stop.
pub fn separate(
    model: &Model,
    problem: &Problem<'_>,
    [first, second]: [&Hypothesis; 2],
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Option<Separation>, FinderError> {
    let Some(task) = &model.task else { return Ok(None) };
    let mut tried: Vec<(f64, Vec<[f64; 2]>)> = Vec::new();
    for number in 0..MOTIONS as u64 {
        let actions = motion(model, task, &mut seed::rng(settings.seed, STREAM + number));
        if let Some(deviations) = deviations(model, problem, [first, second], &actions, settings) {
            tried.push((deviations, actions));
        }
        if on_round().is_break() {
            return Err(FinderError::Cancelled("separate"));
        }
    }
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let usual_deviations = tried.get(tried.len() / 2).map_or(0.0, |t| t.0);
    let between = [first, second].map(|h| h.names().join(" + "));
    Ok(tried.pop().map(|(deviations, actions)| Separation { between, actions, deviations, usual_deviations }))
}

/// A motion of the task's length inside its workspace: deltas that are held for one to four steps.
fn motion<R: Rng>(model: &Model, task: &Task, rng: &mut R) -> Vec<[f64; 2]> {
    let mut at = [model.arm.start.x_m, model.arm.start.z_m];
    let limits = [task.workspace.x_m, task.workspace.z_m];
    let mut actions = Vec::with_capacity(task.steps);
    let (mut delta, mut held) = ([0.0; 2], 0);
    while actions.len() < task.steps {
        if held == 0 {
            delta = std::array::from_fn(|_| rng.random_range(-MAX_DELTA_M..=MAX_DELTA_M));
            held = rng.random_range(1..=4);
        }
        held -= 1;
        let action: [f64; 2] = std::array::from_fn(|i| (at[i] + delta[i]).clamp(limits[i][0], limits[i][1]) - at[i]);
        (0..2).for_each(|i| at[i] += action[i]);
        actions.push(action);
    }
    actions
}

/// What `second`, at its best, would leave of an episode of these actions in which `first` is true.
fn deviations(
    model: &Model,
    problem: &Problem<'_>,
    [first, second]: [&Hypothesis; 2],
    actions: &[[f64; 2]],
    settings: &Settings,
) -> Option<f64> {
    let fidelity = problem.cases.first().map_or(settings.fidelity, |c| c.template.fidelity);
    let planned = Case::planned(model, actions, settings).at(fidelity);
    let own = |h: &Hypothesis| {
        let unknowns = h.unknowns.for_episodes(1);
        let point = unknowns.from_first_episode(&h.unknowns, &h.fit.point);
        (unknowns, point)
    };
    let cases = [planned];
    let (unknowns, point) = own(first);
    let truth = Problem { cases: &cases, unknowns, ..*problem };
    let tracks: Vec<Track> = truth.tracks(&[point.as_slice()]).ok()?.pop()?;
    let cases = [cases[0].with_measured(tracks.first()?.clone())];
    let (unknowns, point) = own(second);
    let model_of_second = Problem { cases: &cases, unknowns, ..*problem };
    let start = Start { point, tracks };
    let seen = model_of_second.look(vec![start], &mut || std::ops::ControlFlow::Continue(())).ok()?;
    Some(seen.into_iter().flatten().next()?.fit.descended().cost)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_of_some_deviations_tells_and_one_of_next_to_none_does_not() {
        let between = ["a".to_owned(), "b".to_owned()];
        let of = |deviations| Separation {
            between: between.clone(),
            actions: Vec::new(),
            deviations,
            usual_deviations: 0.0,
        };
        assert!(of(9.5).tells() && !of(0.4).tells());
        let (some, none) = (crate::sentences::separated(Some(&of(9.5))), crate::sentences::separated(Some(&of(0.4))));
        assert!(
            some.starts_with("a motion that would tell a from b") && none.starts_with("none of the motions"),
            "{none}"
        );
    }

    #[test]
    fn motions_stay_in_the_workspace_and_differ() {
        let model = Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let task = model.task.unwrap();
        let motions: Vec<_> = (0..20).map(|i| motion(&model, &task, &mut seed::rng(5, i))).collect();
        for actions in &motions {
            assert_eq!(actions.len(), task.steps);
            let (mut x, mut z) = (model.arm.start.x_m, model.arm.start.z_m);
            for [dx, dz] in actions {
                (x, z) = (x + dx, z + dz);
                assert!(task.workspace.contains(x, 0.0, z) && dx.abs() <= MAX_DELTA_M && dz.abs() <= MAX_DELTA_M);
            }
        }
        assert!(motions.iter().skip(1).all(|m| *m != motions[0]));
    }
}
