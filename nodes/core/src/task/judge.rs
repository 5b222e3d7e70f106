//! Rules of a task: the reward of a step, success, and the end of an episode.
//!
//! The simulator's environment, the policy runner and the reports share this code, so a reward is the same everywhere.

use super::definition::{Goal, Task};
use super::reward::{LEFT_WORKSPACE_REWARD, REWARD_RANGE, reward};
use crate::track::End;
use crate::{Camera, Frame, Model, Observation, Track};

/// Judge of the episodes of one task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judge {
    task: Task,
    camera: Camera,
}

/// State after a step, as camera and arm report it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// End effector (x, z) in m.
    pub eef_m: [f64; 2],
    /// Four keypoints of the object, scaled to -1 .. 1, in any order.
    pub dlo: [[f64; 2]; 4],
    /// Target, scaled to -1 .. 1.
    pub target: [f64; 2],
    /// True if the hand or its target pose lies outside the workspace.
    pub left_workspace: bool,
    /// True if no further step follows, whatever the verdict.
    pub is_last: bool,
}

impl Moment {
    /// Moment that a policy observed.
    pub fn of(observation: &Observation, left_workspace: bool, is_last: bool) -> Self {
        let (eef_m, dlo, target) = (observation.eef_m(), observation.dlo(), observation.target());
        Self { eef_m, dlo, target, left_workspace, is_last }
    }
}

/// Verdict on a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Reward of the step that led here.
    pub reward: f64,
    /// End of the episode by the task's rules; none if the episode continues to its step limit.
    pub end: Option<End>,
}

impl Judge {
    /// Judge of `task` observed by `camera`.
    pub fn new(task: Task, camera: Camera) -> Self {
        Self { task, camera }
    }

    /// Judge of a model's task; none if the model has no task.
    pub fn of(model: &Model) -> Option<Self> {
        model.task.map(|task| Self::new(task, model.camera.view))
    }

    /// Task that is judged.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// Judges the moment after a step.
    pub fn verdict(&self, moment: &Moment) -> Verdict {
        if moment.left_workspace {
            return Verdict { reward: LEFT_WORKSPACE_REWARD, end: Some(End::LeftWorkspace) };
        }
        match self.task.goal {
            Goal::Reach => {
                let reward = reward(&moment.dlo, moment.target);
                Verdict { reward, end: (reward >= self.task.success_reward).then_some(End::Success) }
            }
            // Only the last moment counts: the path to it is free.
            Goal::PlaceTip { .. } if !moment.is_last => Verdict { reward: 0.0, end: None },
            Goal::PlaceTip { reward_range_m } => {
                let distance_m = self.distance_m(moment);
                let reward = (1.0 - distance_m / reward_range_m).max(0.0);
                let end = if reward >= self.task.success_reward { End::Success } else { End::StepLimit };
                Verdict { reward, end: Some(end) }
            }
        }
    }

    /// Distance in m from the goal: of the tip from the target (`place_tip`), or the root mean square of the four
    /// keypoints' distances (`reach`). It is infinite if the camera's ray misses the plane of motion.
    pub fn distance_m(&self, moment: &Moment) -> f64 {
        let place = |p: [f64; 2]| self.camera.plane_from_scaled(p).unwrap_or([f64::INFINITY; 2]);
        let target = place(moment.target);
        let distances = moment.dlo.map(|p| distance(place(p), target));
        let finite = |d: f64| if d.is_finite() { d } else { f64::INFINITY };
        finite(match self.task.goal {
            Goal::Reach => (distances.iter().map(|d| d * d).sum::<f64>() / 4.0).sqrt(),
            Goal::PlaceTip { .. } => distances[self.tip(moment)],
        })
    }

    /// Distance of a whole episode in m: the least over its steps (`reach`), or that at its end (`place_tip`). It is
    /// infinite for an episode without steps.
    pub fn achieved_m(&self, moments: impl IntoIterator<Item = Moment>) -> f64 {
        let distances = moments.into_iter().map(|m| self.distance_m(&m));
        match self.task.goal {
            Goal::Reach => distances.fold(f64::INFINITY, f64::min),
            Goal::PlaceTip { .. } => distances.last().unwrap_or(f64::INFINITY),
        }
    }

    /// Index of the keypoint at the object's free end: the keypoint farthest from the hand, since trackers may flip the
    /// order.
    pub fn tip(&self, moment: &Moment) -> usize {
        let from_hand = moment.dlo.map(|p| self.camera.plane_from_scaled(p).map_or(0.0, |m| distance(m, moment.eef_m)));
        (0..4).max_by(|&a, &b| from_hand[a].total_cmp(&from_hand[b])).unwrap_or(3)
    }

    /// Distance in m at which a step counts as a success, for example 20 mm for a tip. For `reach` it is the distance
    /// if all four keypoints were at one place; a real object cannot reach zero because of its length.
    pub fn success_distance_m(&self) -> f64 {
        let share = 1.0 - self.task.success_reward;
        match self.task.goal {
            Goal::PlaceTip { reward_range_m } => share * reward_range_m,
            // Four equal distances d have the Frobenius norm 2 d, hence the factor 0.5.
            Goal::Reach => {
                let scaled = 0.5 * REWARD_RANGE * share;
                let place = |x: f64| self.camera.plane_from_scaled([x, 0.0]).unwrap_or([f64::INFINITY; 2]);
                distance(place(scaled), place(0.0))
            }
        }
    }

    /// Moment of frame `step` of a track whose frames are one step apart.
    pub fn moment(&self, frame: &Frame, step: usize, left_workspace: bool) -> Moment {
        let is_last = step >= self.task.steps;
        Moment { eef_m: [frame.eef[0], frame.eef[1]], dlo: frame.dlo, target: frame.target, left_workspace, is_last }
    }

    /// Rewards of the steps of an episode of the task: one fewer than its frames.
    pub fn rewards(&self, track: &Track) -> Vec<f64> {
        let last = track.frames.len().saturating_sub(1);
        let reward = |(step, frame)| {
            let left = step == last && track.end == End::LeftWorkspace;
            self.verdict(&self.moment(frame, step, left)).reward
        };
        track.frames.iter().enumerate().skip(1).map(reward).collect()
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Plane;
    use crate::task::{DeltaAnchor, Workspace};

    /// Judge whose camera maps scaled coordinates to metres around (0, 0), with x to the right.
    fn judge(goal: Goal, success_reward: f64) -> Judge {
        let task = Task {
            goal,
            steps: 2,
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            workspace: Workspace::default(),
            target_m: [0.5, 0.15],
            target_jitter_m: 0.0,
            success_reward,
        };
        Judge::new(task, Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 2.0, ..Plane::default() }))
    }

    fn moment(tip: [f64; 2], is_last: bool) -> Moment {
        let dlo = [[0.1, 0.0], tip, [0.2, 0.0], [0.3, 0.0]];
        Moment { eef_m: [0.0, 0.0], dlo, target: [0.5, 0.0], left_workspace: false, is_last }
    }

    #[test]
    fn the_tip_is_the_keypoint_farthest_from_the_hand_and_counts_at_the_end_alone() {
        let judge = judge(Goal::PlaceTip { reward_range_m: 0.1 }, 0.8);
        let near = moment([0.49, 0.0], true);
        assert_eq!(judge.tip(&near), 1);
        let verdict = judge.verdict(&near);
        assert!((verdict.reward - 0.9).abs() < 1e-9 && verdict.end == Some(End::Success), "{verdict:?}");
        let far = judge.verdict(&moment([0.45, 0.0], true));
        assert!((far.reward - 0.5).abs() < 1e-9 && far.end == Some(End::StepLimit), "{far:?}");
        assert_eq!(judge.verdict(&moment([0.9, 0.0], true)).reward, 0.0);
        assert_eq!(judge.verdict(&moment([0.5, 0.0], false)), Verdict { reward: 0.0, end: None });
        assert!((judge.success_distance_m() - 0.02).abs() < 1e-12);
    }

    #[test]
    fn leaving_the_workspace_ends_every_task_with_minus_one() {
        for goal in [Goal::Reach, Goal::PlaceTip { reward_range_m: 0.1 }] {
            let left = Moment { left_workspace: true, ..moment([0.5, 0.0], true) };
            let expected = Verdict { reward: LEFT_WORKSPACE_REWARD, end: Some(End::LeftWorkspace) };
            assert_eq!(judge(goal, 0.75).verdict(&left), expected);
        }
    }

    #[test]
    fn reach_succeeds_at_any_step_and_its_threshold_is_a_distance() {
        let judge = judge(Goal::Reach, 0.75);
        let d = judge.success_distance_m();
        let at = |x: f64| Moment { dlo: [[0.5 + x, 0.0]; 4], ..moment([0.0; 2], false) };
        assert_eq!(judge.verdict(&at(0.999 * d)).end, Some(End::Success));
        assert_eq!(judge.verdict(&at(1.001 * d)).end, None);
        assert!((judge.distance_m(&at(d)) - d).abs() < 1e-9);
    }

    #[test]
    fn a_track_is_judged_step_by_step() {
        let frame = |x| Frame { time_s: 0.0, dlo: [[x, 0.0]; 4], target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2] };
        let track = |end| Track { frames: vec![frame(1.0), frame(0.15), frame(0.0)], end };
        let reach = judge(Goal::Reach, 0.75);
        assert_eq!(reach.rewards(&track(End::StepLimit)), [0.8, 1.0]);
        assert_eq!(reach.rewards(&track(End::LeftWorkspace)), [0.8, LEFT_WORKSPACE_REWARD]);
        assert!(reach.rewards(&Track::default()).is_empty());
        let tip = judge(Goal::PlaceTip { reward_range_m: 0.1 }, 0.8);
        assert_eq!(tip.rewards(&track(End::StepLimit)), [0.0, 1.0]);
    }
}
