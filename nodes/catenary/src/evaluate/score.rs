//! Scores of policies over a common set of simulated episodes.

use super::episodes::without_early_success;
use anyhow::Result;
use catenary_core::statistics::{self, Z_95, wilson_interval};
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

/// Mean or share with its 95 % interval.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Estimate {
    /// Mean of at least two values, with its interval by the normal approximation.
    fn mean(values: &[f64]) -> Self {
        let value = statistics::mean(values);
        let half = Z_95 * (statistics::variance(values) / values.len() as f64).sqrt();
        Self { value, low: value - half, high: value + half }
    }

    /// Share with its interval by Wilson (1927).
    fn share(hits: usize, of: usize) -> Self {
        let [low, high] = wilson_interval(hits, of);
        Self { value: hits as f64 / of as f64, low, high }
    }

    /// Difference of two shares over the same episodes, with the interval of Agresti and Min (2005). Half a pair is
    /// added to each cell of the table, so that the interval keeps a width even if all pairs agree.
    fn paired(own: &[bool], other: &[bool]) -> Self {
        let n = own.len() as f64;
        let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count() as f64;
        let (gained, lost) = (only(own, other), only(other, own));
        let (g, l, m) = (gained + 0.5, lost + 0.5, n + 2.0);
        let middle = (g - l) / m;
        let half = Z_95 * ((g + l) - (g - l).powi(2) / m).max(0.0).sqrt() / m;
        Self { value: (gained - lost) / n, low: (middle - half).max(-1.0), high: (middle + half).min(1.0) }
    }

    /// Estimate and interval in words, multiplied by `scale`.
    pub fn words(&self, scale: f64, digits: usize) -> String {
        let Self { value, low, high } = self;
        format!("{:.digits$} ({:.digits$} to {:.digits$})", scale * value, scale * low, scale * high)
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
    fn intervals_agree_with_published_values() {
        let e = Estimate::mean(&[1.0, 2.0, 3.0, 4.0]);
        assert!(
            (e.value - 2.5).abs() < 1e-12 && (e.high - e.low - 2.0 * Z_95 * (5.0f64 / 12.0).sqrt()).abs() < 1e-9,
            "{e:?}"
        );
        // Wilson's interval for 5 of 100 is 2.15 to 11.18 %, for 0 of 10 it is 0 to 27.8 %.
        let share = Estimate::share(5, 100);
        assert!((share.low - 0.0215).abs() < 5e-4 && (share.high - 0.1118).abs() < 5e-4, "{share:?}");
        let none = Estimate::share(0, 10);
        assert!(none.low == 0.0 && (none.high - 0.278).abs() < 1e-3, "{none:?}");
    }

    #[test]
    fn the_paired_difference_counts_episodes_that_only_one_policy_solves() {
        let pairs = |both: usize, own: usize, other: usize, none: usize| {
            let column =
                |a: bool, b: bool| [vec![true; both], vec![a; own], vec![b; other], vec![false; none]].concat();
            Estimate::paired(&column(true, false), &column(false, true))
        };
        // 30 gained and 10 lost of 100: (20 +- 1.96 sqrt(41 - 400 / 102)) / 102.
        let e = pairs(40, 30, 10, 20);
        assert!(
            (e.value - 0.2).abs() < 1e-12 && (e.low - 0.0790).abs() < 5e-4 && (e.high - 0.3131).abs() < 5e-4,
            "{e:?}"
        );
        let same = pairs(50, 0, 0, 50);
        assert!(same.value == 0.0 && same.low < 0.0 && same.high > 0.0, "{same:?}");
    }

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
