//! Motion that would separate two explanations.
//!
//! Random motions inside the task's workspace are simulated under both explanations. The best motion is the one for
//! which the second explanation, fitted to the first, leaves the largest residual energy.

use crate::error::FinderError;
use crate::evidence::Hypothesis;
use crate::settings::Settings;
use catenary_core::task::MAX_DELTA_M;
use catenary_core::{Model, Task, Track, seed};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use track_fit::data::MeasuredEpisode;
use track_fit::fitting::{OnRound, Problem, Start};

/// Random stream of the motions.
const STREAM: u64 = 2101;
/// Number of tried motions.
const MOTIONS: usize = 48;

/// Motion that separates two explanations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Separation {
    /// Both explanations, by the names of their effects.
    pub between: [String; 2],
    /// Actions (dx, dz), m, one a step of the task.
    pub actions: Vec<[f64; 2]>,
    /// Residual energy of the second explanation on an episode in which the first is true, in variances of the noise.
    pub deviations: f64,
    /// Residual energy of the median of the tried motions.
    pub usual_deviations: f64,
}

/// Least residual energy of a separating motion: three standard deviations of one coordinate, squared.
const LEAST_DEVIATIONS: f64 = 9.0;

impl Separation {
    /// Returns whether the motion separates the explanations.
    pub fn separates(&self) -> bool {
        self.deviations >= LEAST_DEVIATIONS
    }
}

/// Searches the motion for which `second` differs most from `first`. None if the model has no task, whose workspace
/// bounds the motions, or if no motion can be simulated.
///
/// # Errors
/// [`FinderError::Cancelled`] if `on_round` breaks.
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
        // A motion that cannot be simulated under both explanations is skipped.
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

/// Random motion of the task's length inside its workspace: deltas held for one to four steps.
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

/// Residual energy of `second`, at its linearised minimum, on an episode of these actions in which `first` is true.
fn deviations(
    model: &Model,
    problem: &Problem<'_>,
    [first, second]: [&Hypothesis; 2],
    actions: &[[f64; 2]],
    settings: &Settings,
) -> Option<f64> {
    let fidelity = problem.episodes.first().map_or(settings.fidelity, |c| c.template.fidelity);
    let planned = MeasuredEpisode::planned(model, actions, &settings.of_fits()).at(fidelity);
    let own = |h: &Hypothesis| {
        let unknowns = h.unknowns.for_episodes(1);
        let point = unknowns.from_first_episode(&h.unknowns, &h.fit.point);
        (unknowns, point)
    };
    let episodes = [planned];
    let (unknowns, point) = own(first);
    let truth = Problem { episodes: &episodes, unknowns, ..*problem };
    let tracks: Vec<Track> = truth.tracks(&[point.as_slice()]).ok()?.pop()?;
    let episodes = [episodes[0].with_measured(tracks.first()?.clone())];
    let (unknowns, point) = own(second);
    let model_of_second = Problem { episodes: &episodes, unknowns, ..*problem };
    let start = Start { point, tracks };
    let seen = model_of_second.linearise(vec![start], &mut || std::ops::ControlFlow::Continue(())).ok()?;
    Some(seen.into_iter().flatten().next()?.fit.linear_minimum().cost)
}

#[cfg(test)]
mod tests {
    use super::super::sentences::separated;
    use super::*;

    #[test]
    fn a_motion_separates_if_its_residual_energy_is_at_least_nine() {
        let between = ["a".to_owned(), "b".to_owned()];
        let of = |deviations| Separation {
            between: between.clone(),
            actions: Vec::new(),
            deviations,
            usual_deviations: 0.0,
        };
        assert!(of(9.5).separates() && !of(0.4).separates());
        let (some, none) = (separated(Some(&of(9.5))), separated(Some(&of(0.4))));
        assert!(
            some.starts_with("a motion that would tell a from b") && none.starts_with("none of the motions"),
            "{none}"
        );
    }

    #[test]
    fn motions_stay_in_the_workspace_and_differ() {
        let model = Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
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
