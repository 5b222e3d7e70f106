//! Definition of a task: goal, steps, workspace and target.

use serde::{Deserialize, Serialize};

/// Limit of an action: |dx| and |dz| in m.
pub const MAX_DELTA_M: f64 = 0.06;

/// Greatest distance in m of a target from the measured position. The safety gate refuses a target beyond 0.1 m (its default `max_jump_m`) from a
/// pose that is newer than the one that a policy saw.
pub const MAX_LEAD_M: f64 = 0.09;

/// Greatest number of steps of an episode in a file. It bounds the memory that a damaged file can claim.
pub const MOST_STEPS: usize = 100_000;

/// Range of the distance at which a goal's reward is zero, m. A value outside is probably in another unit.
pub const REWARD_RANGE_M: [f64; 2] = [1e-3, 10.0];

/// Range of the time between two actions, s. A value outside is probably in another unit.
pub const STEP_PERIOD_S: [f64; 2] = [1e-3, 10.0];

/// Pose that an action, a delta of the end effector, is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeltaAnchor {
    /// The measured pose. A soft or slow arm then achieves less than each delta.
    Measured,
    /// The previous target pose. Deltas add up, as long as the target leads the measured pose by less than [`MAX_LEAD_M`].
    #[default]
    LastTarget,
}

/// Box in which the end effector may move, frame panda_link0, m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Least and greatest x.
    pub x_m: [f64; 2],
    /// Least and greatest y.
    pub y_m: [f64; 2],
    /// Least and greatest z.
    pub z_m: [f64; 2],
}

impl Default for Workspace {
    fn default() -> Self {
        Self { x_m: [0.275, 0.6], y_m: [-0.1, 0.1], z_m: [0.1, 0.5] }
    }
}

impl Workspace {
    /// True if the point (m) lies inside.
    pub fn contains(&self, x_m: f64, y_m: f64, z_m: f64) -> bool {
        let inside = |v: f64, [low, high]: [f64; 2]| (low..=high).contains(&v);
        inside(x_m, self.x_m) && inside(y_m, self.y_m) && inside(z_m, self.z_m)
    }
}

/// Goal of a task: what shall be where, and when. Each goal has a distance d in m ([`Referee::distance_m`]). All but
/// `reach` earn `max(0, 1 - d / reward_range_m)` when the episode ends, and nothing before: their paths are free.
///
/// A larger range rewards coarser motions. A smaller one gives an untrained policy no reward to learn from.
///
/// [`Referee::distance_m`]: crate::task::Referee::distance_m
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Goal {
    /// All four keypoints near the target, at any step. Each step earns [`crate::task::reward`].
    #[default]
    Reach,
    /// Free end of the object at the target at the end. d is the distance of the outermost keypoint from the target.
    PlaceTip {
        /// Distance at which the reward is zero, m.
        reward_range_m: f64,
    },
    /// Hand above the target, and the object still, during the rest after the last action. d is the root of the sum of two
    /// squares: the horizontal distance of the hand from the target at the end, and the root mean square distance of the
    /// free end from its mean place over the steps of the rest.
    Settle {
        /// Distance at which the reward is zero, m.
        reward_range_m: f64,
    },
    /// Free end of the object at the target at one of the steps, on its way. d is the least distance of the outermost
    /// keypoint from the target at the end of a step.
    Whip {
        /// Distance at which the reward is zero, m.
        reward_range_m: f64,
    },
    /// Outer half of the object laid down with its free end at the target, at the end. d is the root of the sum of two
    /// squares: the distance of the last keypoint along the object from the target, and the height of the one before it above the
    /// target, at least 0.
    Lay {
        /// Distance at which the reward is zero, m.
        reward_range_m: f64,
    },
}

impl Goal {
    /// Name in a model file.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Reach => "reach",
            Self::PlaceTip { .. } => "place_tip",
            Self::Settle { .. } => "settle",
            Self::Whip { .. } => "whip",
            Self::Lay { .. } => "lay",
        }
    }

    /// Distance in m at which the reward of the end is zero; none for `reach`, whose every step is rewarded.
    pub fn reward_range_m(&self) -> Option<f64> {
        match *self {
            Self::Reach => None,
            Self::PlaceTip { reward_range_m }
            | Self::Settle { reward_range_m }
            | Self::Whip { reward_range_m }
            | Self::Lay { reward_range_m } => Some(reward_range_m),
        }
    }

    /// True for the default goal, which model files omit.
    fn is_reach(&self) -> bool {
        *self == Self::Reach
    }
}

/// Task of a model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Goal of an episode.
    #[serde(default, skip_serializing_if = "Goal::is_reach")]
    pub goal: Goal,
    /// Actions of an episode.
    pub steps: usize,
    /// Steps after the last action in which the hand stays at its target.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rest_steps: usize,
    /// Time between two actions in s.
    pub step_period_s: f64,
    /// Pose that a delta is added to.
    pub delta_anchor: DeltaAnchor,
    /// Box of the end effector. Leaving it ends the episode with [`crate::task::LEFT_WORKSPACE_REWARD`].
    #[serde(default)]
    pub workspace: Workspace,
    /// (x, z) in m of the target's centre, frame panda_link0.
    pub target_m: [f64; 2],
    /// Half width in m of the uniform jitter of the target, in x and in z.
    pub target_jitter_m: f64,
    /// Least reward of a successful step.
    #[serde(default = "success_reward")]
    pub success_reward: f64,
    /// True if the first success of `reach` ends the episode, as in the paper. What the remaining steps would have earned is
    /// then lost: a policy that stays just short of success earns more than one that succeeds.
    #[serde(default, skip_serializing_if = "is_false")]
    pub ends_at_success: bool,
}

impl Task {
    /// Steps of a whole episode, with those of the rest.
    pub fn all_steps(&self) -> usize {
        self.steps + self.rest_steps
    }

    /// Steps of rest after this many actions: those of the task, if these are all of its actions.
    pub fn rest_after(&self, actions: usize) -> usize {
        if actions == self.steps { self.rest_steps } else { 0 }
    }

    /// True if a position (x, z) in m of the end effector, measured or commanded, lies inside the workspace. The plane of
    /// motion is y = 0.
    pub fn allows(&self, [x_m, z_m]: [f64; 2]) -> bool {
        self.workspace.contains(x_m, 0.0, z_m)
    }
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

fn is_false(value: &bool) -> bool {
    !value
}

fn success_reward() -> f64 {
    0.75
}
