//! Linear model of the episodes of a plan.

use super::loss::loss;
use catenary_core::task::MAX_DELTA_M;
use catenary_core::{Frame, Judge, Track};

/// Numbers of a frame that depend on actions: four keypoints (x, y), and the hand's x and z.
const NUMBERS: usize = 10;
/// Distance in m from the border of the workspace that a plan keeps: more than the change that gives the derivatives.
const MARGIN_M: f64 = 0.008;
/// Actions beyond the limit that cost nothing, in units of the limit: the limit clips them, and gives no slope to come back by.
const MOST_ACTION: f64 = 1.05;
/// Weights of what a plan must not do: leave the trusted change, ask for more than the limit, leave the workspace. Each makes a violation that
/// matters cost more than it can gain, in m of distance.
const WEIGHTS: [f64; 3] = [10.0, 1.0, 100.0];

/// Actions that the arm executes, in units of the limit.
pub fn executed(actions: &[f64]) -> Vec<f64> {
    actions.iter().map(|a| a.clamp(-1.0, 1.0)).collect()
}

/// Distance in m by which the targets of the hand leave the workspace less its margin, summed over the steps. `frames` give the measured poses;
/// without them the hand is taken to be at each target.
pub fn outside_m(judge: &Judge, start_m: [f64; 2], executed: &[f64], frames: Option<&[Frame]>) -> f64 {
    let task = judge.task();
    let beyond = |v: f64, [low, high]: [f64; 2]| (low + MARGIN_M - v).max(v - high + MARGIN_M).max(0.0);
    let (mut at, mut sum) = (start_m, 0.0);
    for (step, delta) in executed.chunks_exact(2).enumerate() {
        let measured = frames.and_then(|frames| frames.get(step)).map_or(at, |frame| [frame.eef[0], frame.eef[1]]);
        at = task.delta_anchor.target_m([0, 1].map(|i| MAX_DELTA_M * delta[i]), measured, at, 0.0);
        sum += beyond(at[0], task.workspace.x_m) + beyond(at[1], task.workspace.z_m);
    }
    sum
}

/// Linear model of the episodes of a plan: frames as functions of the actions.
pub struct Linear {
    episodes: Vec<Episode>,
}

struct Episode {
    track: Track,
    target: [f64; 2],
    planned: Vec<f64>,
    executed: Vec<f64>,
    /// For each action, the derivatives of the frames by it.
    by: Vec<Vec<[f64; NUMBERS]>>,
}

impl Linear {
    /// Model without derivatives of the episodes of a plan. `actions` gives the plan's actions at a target.
    pub fn new(tracks: &[Track], actions: impl Fn([f64; 2]) -> Vec<f64>) -> Self {
        let episode = |track: &Track| {
            let target = track.frames.first().map_or([0.0; 2], |frame| frame.target);
            let planned = actions(target);
            Episode { track: track.clone(), target, executed: executed(&planned), planned, by: Vec::new() }
        };
        Self { episodes: tracks.iter().map(episode).collect() }
    }

    /// Adds the derivatives by `action` from the episodes of the plan in which it is larger by `change`.
    pub fn add(&mut self, action: usize, change: f64, changed: &[Track]) {
        for (episode, other) in self.episodes.iter_mut().zip(changed) {
            let change = (episode.planned[action] + change).clamp(-1.0, 1.0) - episode.executed[action];
            let frames = &episode.track.frames;
            // Without a derivative where the limit clips the whole change, or the changed episode ended early.
            let is_known = other.frames.len() == frames.len() && change.abs() > 1e-3;
            let slope = |(before, after): (&Frame, &Frame)| {
                let (before, after) = (numbers(before), numbers(after));
                std::array::from_fn(|i| if is_known { (after[i] - before[i]) / change } else { 0.0 })
            };
            let mut slopes: Vec<[f64; NUMBERS]> = frames.iter().zip(&other.frames).map(slope).collect();
            slopes.resize(frames.len(), [0.0; NUMBERS]);
            episode.by.push(slopes);
        }
    }

    /// Mean loss of the plan with these actions at a target. No action may change by more than `trust` without a penalty.
    pub fn loss(&self, judge: &Judge, start_m: [f64; 2], actions: &dyn Fn([f64; 2]) -> Vec<f64>, trust: f64) -> f64 {
        let losses = self.episodes.iter().map(|episode| episode.loss(judge, start_m, &actions(episode.target), trust));
        losses.sum::<f64>() / self.episodes.len() as f64
    }
}

impl Episode {
    fn loss(&self, judge: &Judge, start_m: [f64; 2], planned: &[f64], trust: f64) -> f64 {
        let executed = executed(planned);
        let mut track = self.track.clone();
        let (mut far, mut clipped) = (0.0, 0.0);
        for (action, by) in self.by.iter().enumerate() {
            let change = executed[action] - self.executed[action];
            far += (change.abs() - trust).max(0.0).powi(2);
            clipped += (planned[action].abs() - MOST_ACTION).max(0.0).powi(2);
            // An action moves the frames after its step.
            for (frame, by) in track.frames.iter_mut().zip(by).skip(action / 2 + 1) {
                for (i, point) in frame.dlo.iter_mut().enumerate() {
                    *point = [point[0] + change * by[2 * i], point[1] + change * by[2 * i + 1]];
                }
                frame.eef[0] += change * by[8];
                frame.eef[1] += change * by[9];
            }
        }
        let outside = outside_m(judge, start_m, &executed, Some(&track.frames));
        let penalty = WEIGHTS.into_iter().zip([far, clipped, outside]).map(|(weight, by)| weight * by);
        loss(judge, &track) + penalty.sum::<f64>()
    }
}

fn numbers(frame: &Frame) -> [f64; NUMBERS] {
    let [a, b, c, d] = frame.dlo;
    [a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1], frame.eef[0], frame.eef[1]]
}
