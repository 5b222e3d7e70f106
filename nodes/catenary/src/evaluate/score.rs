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

/// Runs every policy on the episodes of `requested`, whose drive is replaced. `on_progress` receives the current policy
/// and the number of finished episodes. It may end the run with an error.
pub fn score(
    model: &Model,
    judge: &Judge,
    policies: Vec<(PathBuf, Policy)>,
    requested: &SimulationRequest,
    on_progress: &mut dyn FnMut(&Path, usize) -> Result<()>,
) -> Result<Vec<Evaluated>> {
    let simulator = BeamSimulator::new(&without_early_success(model), workers::available())?;
    let n = requested.thetas.len();
    let mut evaluated: Vec<Evaluated> = Vec::new();
    for (path, policy) in policies {
        let asked = SimulationRequest { drive: Drive::Policy(Box::new(policy)), ..requested.clone() };
        let mut tracks = Vec::new();
        while tracks.len() < n {
            // Before each batch, so that Ctrl-C is seen within one batch.
            on_progress(&path, evaluated.len() * n + tracks.len())?;
            tracks.extend(simulator.simulate(&asked.part(tracks.len()..tracks.len() + BATCH))?);
        }
        on_progress(&path, (evaluated.len() + 1) * n)?;
        evaluated.push(of(&path, &tracks, judge, evaluated.first()));
    }
    Ok(evaluated)
}

/// Scores of the policy of `path` from its tracks; differences are taken to `first`.
fn of(path: &Path, tracks: &[Track], judge: &Judge, first: Option<&Evaluated>) -> Evaluated {
    let scores: Vec<Score> = tracks.iter().map(|t| judge.score(t)).collect();
    let returns: Vec<f64> = scores.iter().map(|s| s.rewards.iter().sum()).collect();
    let best: Vec<f64> = scores.iter().map(|s| s.rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max)).collect();
    let successes: Vec<bool> = scores.iter().map(|s| s.succeeded).collect();
    let left = tracks.iter().filter(|t| t.end == End::LeftWorkspace).count();
    let gained = |first: &Evaluated| -> Estimate {
        Estimate::mean(&returns.iter().zip(&first.returns).map(|(own, other)| own - other).collect::<Vec<_>>())
    };
    Evaluated {
        policy: path.to_owned(),
        distances_m: scores.iter().map(|s| s.distance_m).collect(),
        mean_return: Estimate::mean(&returns),
        mean_best_reward: Estimate::mean(&best),
        success_rate: Estimate::share(successes.iter().filter(|s| **s).count(), tracks.len()),
        left_workspace: left as f64 / tracks.len() as f64,
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
        let frame = |x| Frame { time_s: 0.0, dlo: [[x, 0.0]; 4], target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };
        let track = |x, end| Track { frames: vec![frame(1.0), frame(x), frame(0.75)], end };
        let first = of(Path::new("a"), &[track(0.75, End::StepLimit), track(0.15, End::StepLimit)], &judge, None);
        assert!(first.mean_return_gained.is_none() && first.returns == [0.0, 0.8], "{first:?}");
        assert_eq!((first.success_rate.value, first.left_workspace), (0.5, 0.0));
        let other = [track(0.15, End::StepLimit), track(0.15, End::LeftWorkspace)];
        let second = of(Path::new("b"), &other, &judge, Some(&first));
        let gained = second.mean_return_gained.unwrap();
        assert!((gained.value - (-0.1)).abs() < 1e-12, "{gained:?}");
        assert_eq!((second.success_rate.value, second.left_workspace), (1.0, 0.5));
        assert_eq!(second.success_gained.unwrap().value, 0.5);
    }
}
