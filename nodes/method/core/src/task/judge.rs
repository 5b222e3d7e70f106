//! Rules of a task: the reward of a step, success, and the end of an episode.
//!
//! The simulator's environment, the policy runner and the reports share this code, so a reward is the same everywhere.

use super::definition::{Goal, Task};
use super::reward::{LEFT_WORKSPACE_REWARD, REWARD_RANGE, reward};
use crate::keypoints::ORDERS;
use crate::track::End;
use crate::{Camera, Frame, Model, Observation, Track};

/// Judge of the episodes of one task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judge {
    task: Task,
    camera: Camera,
}

/// Part of an episode that a moment belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Moment after an action, also after the last one if a rest follows.
    Action,
    /// Moment after a step of the rest, but the last.
    Rest,
    /// Last moment of the episode: after the last step of the rest, or after the last action if there is none.
    Last,
}

impl Phase {
    /// Phase of the moment after `step` steps of an episode with `actions` actions and `rest_steps` steps of rest.
    pub fn of(step: usize, actions: usize, rest_steps: usize) -> Self {
        if step >= actions + rest_steps {
            Self::Last
        } else if step > actions {
            Self::Rest
        } else {
            Self::Action
        }
    }
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
    /// Part of the episode.
    pub phase: Phase,
}

impl Moment {
    /// Moment that a policy observed.
    pub fn of(observation: &Observation, left_workspace: bool, phase: Phase) -> Self {
        let (eef_m, dlo, target) = (observation.eef_m(), observation.dlo(), observation.target());
        Self { eef_m, dlo, target, left_workspace, phase }
    }
}

/// Verdict on a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Reward of the step that led here.
    pub reward: f64,
    /// End of the episode, if it ends here: by the task's rules, or because no step follows.
    pub end: Option<End>,
}

/// Score of a whole episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// Reward of each step.
    pub rewards: Vec<f64>,
    /// Distance d from the goal in m ([`Goal`]). For `reach` and `whip` the least over the steps, otherwise that at the end.
    /// Infinite for an episode without steps.
    pub distance_m: f64,
    /// True if a step earned `success_reward`.
    pub succeeded: bool,
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

    /// Referee of a new episode.
    pub fn referee(&self) -> Referee {
        Referee { judge: *self, distance_m: f64::INFINITY, tips: Spread::default(), succeeded: false }
    }

    /// Distance in m from the goal by what is seen at one moment: of the tip from the target (`place_tip`, `whip`), of the outer
    /// half from lying there (`lay`), of the hand along x (`settle`, without the motion of the tip), or the root mean square
    /// of the four keypoints' distances (`reach`). It is infinite if the camera's ray misses the plane of motion.
    pub fn distance_m(&self, moment: &Moment) -> f64 {
        let place = |p: [f64; 2]| self.camera.plane_from_scaled(p).unwrap_or([f64::INFINITY; 2]);
        let target = place(moment.target);
        let distances = moment.dlo.map(|p| distance(place(p), target));
        let finite = |d: f64| if d.is_finite() { d } else { f64::INFINITY };
        finite(match self.task.goal {
            Goal::Reach => (distances.iter().map(|d| d * d).sum::<f64>() / 4.0).sqrt(),
            Goal::PlaceTip { .. } | Goal::Whip { .. } => distances[self.tip(moment)],
            Goal::Settle { .. } => (moment.eef_m[0] - target[0]).abs(),
            Goal::Lay { .. } => {
                let [tip, next] = self.outer_half(moment);
                distance(tip, target).hypot((next[1] - target[1]).max(0.0))
            }
        })
    }

    /// Index of the keypoint at the object's free end: the keypoint farthest from the hand, since trackers may flip the
    /// order.
    pub fn tip(&self, moment: &Moment) -> usize {
        let from_hand = moment.dlo.map(|p| self.camera.plane_from_scaled(p).map_or(0.0, |m| distance(m, moment.eef_m)));
        (0..4).max_by(|&a, &b| from_hand[a].total_cmp(&from_hand[b])).unwrap_or(3)
    }

    /// Places (x, z) in m of the outermost keypoint and of the next one: the last two on the shortest path from the hand
    /// through all four. The tip of an object that is bent back may be nearer to the hand than its middle.
    fn outer_half(&self, moment: &Moment) -> [[f64; 2]; 2] {
        let places = moment.dlo.map(|p| self.camera.plane_from_scaled(p).unwrap_or([f64::INFINITY; 2]));
        let length = |order: &[usize; 4]| -> f64 {
            let steps = order.windows(2).map(|p| distance(places[p[0]], places[p[1]]));
            distance(moment.eef_m, places[order[0]]) + steps.sum::<f64>()
        };
        let along = ORDERS.into_iter().min_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or([0, 1, 2, 3]);
        [places[along[3]], places[along[2]]]
    }

    /// Distance in m at which an episode counts as a success, for example 20 mm for a tip. For `reach` it is the distance
    /// if all four keypoints were at one place; a real object cannot reach zero because of its length.
    pub fn success_distance_m(&self) -> f64 {
        let share = 1.0 - self.task.success_reward;
        match self.task.goal.reward_range_m() {
            Some(reward_range_m) => share * reward_range_m,
            // Four equal distances d have the Frobenius norm 2 d, hence the factor 0.5.
            None => {
                let scaled = 0.5 * REWARD_RANGE * share;
                let place = |x: f64| self.camera.plane_from_scaled([x, 0.0]).unwrap_or([f64::INFINITY; 2]);
                distance(place(scaled), place(0.0))
            }
        }
    }

    /// Moment of frame `step` of a track whose frames are one step apart.
    pub fn moment(&self, frame: &Frame, step: usize, left_workspace: bool) -> Moment {
        let phase = Phase::of(step, self.task.steps, self.task.rest_steps);
        Moment { eef_m: [frame.eef[0], frame.eef[1]], dlo: frame.dlo, target: frame.target, left_workspace, phase }
    }

    /// Score of an episode of the task, whose frames are one step apart. Its rewards are one fewer than its frames.
    pub fn score(&self, track: &Track) -> Score {
        let last = track.frames.len().saturating_sub(1);
        let mut referee = self.referee();
        let steps = track.frames.iter().enumerate().skip(1);
        let rewards = steps.map(|(step, frame)| {
            let left = step == last && track.end == End::LeftWorkspace;
            referee.verdict(&self.moment(frame, step, left)).reward
        });
        let rewards = rewards.collect();
        Score { rewards, distance_m: referee.distance_m(), succeeded: referee.has_succeeded() }
    }
}

/// Judge of one episode, moment by moment: the reward of a moment may depend on those before it.
#[derive(Debug, Clone, PartialEq)]
pub struct Referee {
    judge: Judge,
    distance_m: f64,
    tips: Spread,
    succeeded: bool,
}

impl Referee {
    /// Judges the moment after a step. Moments come in their order, without the first, which no step led to.
    pub fn verdict(&mut self, moment: &Moment) -> Verdict {
        let Judge { task, .. } = self.judge;
        self.look(moment);
        if moment.left_workspace {
            return Verdict { reward: LEFT_WORKSPACE_REWARD, end: Some(End::LeftWorkspace) };
        }
        let is_last = moment.phase == Phase::Last;
        let reward = match task.goal.reward_range_m() {
            None => reward(&moment.dlo, moment.target),
            // The path to the end is free.
            Some(_) if !is_last => 0.0,
            Some(reward_range_m) => (1.0 - self.distance_m / reward_range_m).max(0.0),
        };
        let reaches = reward >= task.success_reward;
        self.succeeded |= reaches;
        let end = if is_last {
            Some(if self.succeeded { End::Success } else { End::StepLimit })
        } else {
            (reaches && task.ends_at_success).then_some(End::Success)
        };
        Verdict { reward, end }
    }

    /// Distance d from the goal in m ([`Goal`]): for `reach` and `whip` the least so far, otherwise that if the episode ended now.
    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }

    /// True if a step so far earned `success_reward`.
    pub fn has_succeeded(&self) -> bool {
        self.succeeded
    }

    fn look(&mut self, moment: &Moment) {
        let Self { judge, .. } = *self;
        let now_m = judge.distance_m(moment);
        self.distance_m = match judge.task.goal {
            Goal::Reach | Goal::Whip { .. } => self.distance_m.min(now_m),
            Goal::PlaceTip { .. } | Goal::Lay { .. } => now_m,
            Goal::Settle { .. } => {
                if moment.phase != Phase::Action {
                    let tip = judge.camera.plane_from_scaled(moment.dlo[judge.tip(moment)]);
                    self.tips.add(tip.unwrap_or([f64::INFINITY; 2]));
                }
                let all_m = now_m.hypot(self.tips.deviation());
                if all_m.is_finite() { all_m } else { f64::INFINITY }
            }
        };
    }
}

/// Spread of some places.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Spread {
    count: f64,
    mean: [f64; 2],
    /// Sum of the squared distances from the mean.
    squares: f64,
}

impl Spread {
    /// Adds a place (Welford 1962).
    fn add(&mut self, place: [f64; 2]) {
        self.count += 1.0;
        for (mean, value) in self.mean.iter_mut().zip(place) {
            let off = value - *mean;
            *mean += off / self.count;
            self.squares += off * (value - *mean);
        }
    }

    /// Root mean square distance from the mean; 0 without places.
    fn deviation(&self) -> f64 {
        if self.count == 0.0 { 0.0 } else { (self.squares / self.count).max(0.0).sqrt() }
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
            rest_steps: 0,
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            workspace: Workspace::default(),
            target_m: [0.5, 0.15],
            target_jitter_m: 0.0,
            success_reward,
            ends_at_success: false,
        };
        Judge::new(task, Camera::Plane(Plane { centre_m: [0.0, 0.0], side_m: 2.0, ..Plane::default() }))
    }

    fn moment(tip: [f64; 2], phase: Phase) -> Moment {
        let dlo = [[0.1, 0.0], tip, [0.2, 0.0], [0.3, 0.0]];
        Moment { eef_m: [0.0, 0.0], dlo, target: [0.5, 0.0], left_workspace: false, phase }
    }

    #[test]
    fn the_tip_is_the_keypoint_farthest_from_the_hand_and_counts_at_the_end_alone() {
        let judge = judge(Goal::PlaceTip { reward_range_m: 0.1 }, 0.8);
        let near = moment([0.49, 0.0], Phase::Last);
        assert_eq!(judge.tip(&near), 1);
        let verdict = |moment: &Moment| judge.referee().verdict(moment);
        let reached = verdict(&near);
        assert!((reached.reward - 0.9).abs() < 1e-9 && reached.end == Some(End::Success), "{reached:?}");
        let far = verdict(&moment([0.45, 0.0], Phase::Last));
        assert!((far.reward - 0.5).abs() < 1e-9 && far.end == Some(End::StepLimit), "{far:?}");
        assert_eq!(verdict(&moment([0.9, 0.0], Phase::Last)).reward, 0.0);
        assert_eq!(verdict(&moment([0.5, 0.0], Phase::Action)), Verdict { reward: 0.0, end: None });
        assert!((judge.success_distance_m() - 0.02).abs() < 1e-12);
    }

    #[test]
    fn leaving_the_workspace_ends_every_task_with_minus_one() {
        let reward_range_m = 0.1;
        for goal in [
            Goal::Reach,
            Goal::PlaceTip { reward_range_m },
            Goal::Settle { reward_range_m },
            Goal::Whip { reward_range_m },
            Goal::Lay { reward_range_m },
        ] {
            let left = Moment { left_workspace: true, ..moment([0.5, 0.0], Phase::Last) };
            let expected = Verdict { reward: LEFT_WORKSPACE_REWARD, end: Some(End::LeftWorkspace) };
            assert_eq!(judge(goal, 0.75).referee().verdict(&left), expected);
        }
    }

    #[test]
    fn reach_succeeds_at_any_step_and_ends_there_only_if_the_task_says_so() {
        let judge = judge(Goal::Reach, 0.75);
        let d = judge.success_distance_m();
        let at = |x: f64, phase| Moment { dlo: [[0.5 + x, 0.0]; 4], ..moment([0.0; 2], phase) };
        let mut referee = judge.referee();
        assert_eq!(referee.verdict(&at(0.999 * d, Phase::Action)).end, None);
        assert!(referee.has_succeeded() && (referee.distance_m() - 0.999 * d).abs() < 1e-9);
        // A success stays one if the object moves away again.
        assert_eq!(referee.verdict(&at(3.0 * d, Phase::Last)).end, Some(End::Success));
        assert_eq!(judge.referee().verdict(&at(1.001 * d, Phase::Last)).end, Some(End::StepLimit));
        let ending = Judge::new(Task { ends_at_success: true, ..*judge.task() }, judge.camera);
        assert_eq!(ending.referee().verdict(&at(0.999 * d, Phase::Action)).end, Some(End::Success));
        assert_eq!(ending.referee().verdict(&at(1.001 * d, Phase::Action)).end, None);
    }

    #[test]
    fn settling_counts_the_hand_and_the_motion_of_the_tip_in_the_rest() {
        let judge = judge(Goal::Settle { reward_range_m: 0.1 }, 0.75);
        let mut referee = judge.referee();
        let at = |tip: f64, phase| Moment { eef_m: [0.47, 0.4], ..moment([tip, -0.9], phase) };
        assert_eq!(referee.verdict(&at(0.9, Phase::Action)).reward, 0.0);
        for tip in [0.03, -0.03, 0.03] {
            referee.verdict(&at(tip, Phase::Rest));
        }
        // The hand is 30 mm beside the target, and the tip 30 mm from its mean place.
        let last = referee.verdict(&at(-0.03, Phase::Last));
        assert!((referee.distance_m() - 0.03 * 2f64.sqrt()).abs() < 1e-9, "{}", referee.distance_m());
        assert!((last.reward - (1.0 - 0.3 * 2f64.sqrt())).abs() < 1e-9, "{last:?}");
    }

    #[test]
    fn a_whip_counts_its_nearest_step_and_is_paid_at_the_end() {
        let mut referee = judge(Goal::Whip { reward_range_m: 0.1 }, 0.8).referee();
        assert_eq!(referee.verdict(&moment([0.49, 0.0], Phase::Action)), Verdict { reward: 0.0, end: None });
        let last = referee.verdict(&moment([0.9, 0.0], Phase::Last));
        assert!((last.reward - 0.9).abs() < 1e-9 && last.end == Some(End::Success), "{last:?}");
    }

    #[test]
    fn what_is_laid_has_its_tip_at_the_target_and_its_outer_half_down() {
        let judge = judge(Goal::Lay { reward_range_m: 0.1 }, 0.8);
        // Laid down beyond the target and bent back: the tip is nearer to the hand than its neighbour.
        let laid = |next_z: f64| Moment {
            eef_m: [0.5, 0.3],
            dlo: [[0.5, -0.2], [0.53, 0.0], [0.6, -next_z], [0.6, -0.1]],
            ..moment([0.0; 2], Phase::Last)
        };
        assert!((judge.distance_m(&laid(0.0)) - 0.03).abs() < 1e-9);
        assert!((judge.distance_m(&laid(0.04)) - 0.05).abs() < 1e-9);
    }

    #[test]
    fn a_track_is_judged_step_by_step() {
        let frame = |x| Frame {
            time_s: 0.0,
            dlo: [[x, 0.0]; 4],
            target: [0.0; 2],
            eef: [0.0; 3],
            action: [0.0; 2],
            wrench: None,
        };
        let track = |end| Track { frames: vec![frame(1.0), frame(0.15), frame(0.0)], end };
        let reach = judge(Goal::Reach, 0.75);
        let score = reach.score(&track(End::StepLimit));
        assert_eq!((&score.rewards[..], score.succeeded), (&[0.8, 1.0][..], true));
        assert!(score.distance_m < 1e-12);
        assert_eq!(reach.score(&track(End::LeftWorkspace)).rewards, [0.8, LEFT_WORKSPACE_REWARD]);
        let none = reach.score(&Track::default());
        assert!(none.rewards.is_empty() && none.distance_m == f64::INFINITY && !none.succeeded);
        let tip = judge(Goal::PlaceTip { reward_range_m: 0.1 }, 0.8);
        assert_eq!(tip.score(&track(End::StepLimit)).rewards, [0.0, 1.0]);
    }

    #[test]
    fn phases_follow_the_actions_and_the_rest() {
        let of = |rest| (0..7).map(|step| Phase::of(step, 3, rest)).collect::<Vec<_>>();
        use Phase::{Action as A, Last as L, Rest as R};
        assert_eq!(of(0), [A, A, A, L, L, L, L]);
        assert_eq!(of(2), [A, A, A, A, R, L, L]);
    }
}
