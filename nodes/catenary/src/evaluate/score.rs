//! Scores of policies over a common set of simulated episodes.

use super::episodes::without_early_success;
use crate::report::Estimate;
use anyhow::Result;
use catenary_core::statistics;
use catenary_core::task::Score;
use catenary_core::track::End;
use catenary_core::{Drive, Judge, Model, Policy, SimulationRequest, Simulator, Track};
use catenary_simulator::{BeamSimulator, workers};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Episodes between two updates of the progress bar.
const BATCH: usize = 16;

/// Scores of one policy.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Evaluated {
    /// File of the policy.
    pub policy: PathBuf,
    /// Sum of the rewards of all steps, by episode.
    pub returns: Vec<f64>,
    /// True for each episode in which the best reward reached the task's goal.
    pub successes: Vec<bool>,
    /// Distance that the task minimises, by episode, m: at the nearest step (`reach`, `whip`) or at the end.
    pub distances_m: Vec<f64>,
    /// Mean of the returns.
    pub mean_return: Estimate,
    /// Mean over episodes of the best reward in one step.
    pub mean_best_reward: Estimate,
    /// Share of the episodes that succeeded.
    pub success_rate: Estimate,
    /// Share of the episodes that ended because the arm left its workspace.
    pub left_workspace: f64,
    /// Paired difference of the return to the first policy; `None` for the first policy.
    pub mean_return_gained: Option<Estimate>,
    /// Paired difference of the success rate to the first policy; `None` for the first policy.
    pub success_gained: Option<Estimate>,
}

impl Evaluated {
    /// Median over the episodes of the distance that the task minimises, m.
    pub fn median_distance_m(&self) -> f64 {
        statistics::median(&mut self.distances_m.clone())
    }
}

/// Score of one episode.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// Sum of the rewards.
    episode_return: f64,
    /// Best reward of a step.
    best_reward: f64,
    succeeded: bool,
    /// Distance that the task minimises, m.
    distance_m: f64,
    left_workspace: bool,
}

impl Scored {
    fn of(track: &Track, judge: &Judge) -> Self {
        let Score { rewards, distance_m, succeeded } = judge.score(track);
        Self {
            episode_return: rewards.iter().sum(),
            best_reward: rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            succeeded,
            distance_m,
            left_workspace: track.end == End::LeftWorkspace,
        }
    }
}

/// Scores of finished episodes, by policy.
pub type Finished = Vec<Vec<Scored>>;

/// Runs every policy on the episodes of `requested`, whose drive is replaced. `on_progress` receives the current policy
/// and the number of finished episodes. It may end the run with an error.
pub fn score(
    model: &Model,
    judge: &Judge,
    policies: Vec<(PathBuf, Policy)>,
    requested: &SimulationRequest,
    on_progress: &mut dyn FnMut(&Path, usize) -> Result<()>,
) -> Result<Vec<Evaluated>> {
    score_from(&mut Vec::new(), model, judge, policies, requested, on_progress)
}

/// Scores as [`score`], without the episodes that `finished` holds already. It holds all finished ones afterwards, also if the run ended early.
pub fn score_from(
    finished: &mut Finished,
    model: &Model,
    judge: &Judge,
    policies: Vec<(PathBuf, Policy)>,
    requested: &SimulationRequest,
    on_progress: &mut dyn FnMut(&Path, usize) -> Result<()>,
) -> Result<Vec<Evaluated>> {
    let simulator = BeamSimulator::new(&without_early_success(model), workers::available())?;
    let n = requested.thetas.len();
    let mut evaluated: Vec<Evaluated> = Vec::new();
    finished.resize(policies.len(), Vec::new());
    for ((path, policy), scores) in policies.into_iter().zip(finished.iter_mut()) {
        let asked = SimulationRequest { drive: Drive::Policy(Box::new(policy)), ..requested.clone() };
        scores.truncate(n);
        while scores.len() < n {
            // Before each batch, so that Ctrl-C is seen within one batch.
            on_progress(&path, evaluated.len() * n + scores.len())?;
            let tracks = simulator.simulate(&asked.part(scores.len()..scores.len() + BATCH))?;
            scores.extend(tracks.iter().map(|track| Scored::of(track, judge)));
        }
        on_progress(&path, (evaluated.len() + 1) * n)?;
        evaluated.push(of(&path, scores, evaluated.first()));
    }
    Ok(evaluated)
}

/// Scores of the policy of `path` from those of its episodes; differences are taken to `first`.
fn of(path: &Path, scores: &[Scored], first: Option<&Evaluated>) -> Evaluated {
    let returns: Vec<f64> = scores.iter().map(|s| s.episode_return).collect();
    let best: Vec<f64> = scores.iter().map(|s| s.best_reward).collect();
    let successes: Vec<bool> = scores.iter().map(|s| s.succeeded).collect();
    let left = scores.iter().filter(|s| s.left_workspace).count();
    let gained = |first: &Evaluated| -> Estimate {
        Estimate::mean(&returns.iter().zip(&first.returns).map(|(own, other)| own - other).collect::<Vec<_>>())
    };
    Evaluated {
        policy: path.to_owned(),
        distances_m: scores.iter().map(|s| s.distance_m).collect(),
        mean_return: Estimate::mean(&returns),
        mean_best_reward: Estimate::mean(&best),
        success_rate: Estimate::share(successes.iter().filter(|s| **s).count(), scores.len()),
        left_workspace: left as f64 / scores.len() as f64,
        mean_return_gained: first.map(gained),
        success_gained: first.map(|first| Estimate::paired(&successes, &first.successes)),
        returns,
        successes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Frame;

    #[test]
    fn policies_are_compared_with_the_first_episode_by_episode() {
        let model = crate::inputs::model_file::read_or_soft_bar(None).unwrap();
        let judge = Judge::of(&model).unwrap();
        // The distance of all keypoints from the target is x, so that the reward is 1 - 2 x / 1.5.
        let frame = |x| Frame {
            time_s: 0.0,
            dlo: [[x, 0.0]; 4],
            target: [0.0; 2],
            eef: [0.0; 3],
            action: [0.0; 2],
            wrench: None,
        };
        let track = |x, end| Track { frames: vec![frame(1.0), frame(x), frame(0.75)], end };
        let scored = |tracks: [Track; 2]| tracks.map(|track| Scored::of(&track, &judge));
        let first = of(Path::new("a"), &scored([track(0.75, End::StepLimit), track(0.15, End::StepLimit)]), None);
        assert!(first.mean_return_gained.is_none() && first.returns == [0.0, 0.8], "{first:?}");
        assert_eq!((first.success_rate.value, first.left_workspace), (0.5, 0.0));
        let other = [track(0.15, End::StepLimit), track(0.15, End::LeftWorkspace)];
        let second = of(Path::new("b"), &scored(other), Some(&first));
        let gained = second.mean_return_gained.unwrap();
        assert!((gained.value - (-0.1)).abs() < 1e-12, "{gained:?}");
        assert_eq!((second.success_rate.value, second.left_workspace), (1.0, 0.5));
        assert_eq!(second.success_gained.unwrap().value, 0.5);
    }
}
