//! Definition of a task: goal, steps, workspace and target.

use serde::{Deserialize, Serialize};

/// Limit of an action: |dx| and |dz| in m.
pub const MAX_DELTA_M: f64 = 0.06;

/// Pose that an action, a delta of the end effector, is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeltaAnchor {
    /// The measured pose. A soft or slow arm then achieves less than each delta.
    Measured,
    /// The previous target pose. Deltas add up exactly.
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

/// Goal of a task: a part of the object, its place, and the time at which it counts.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Goal {
    /// All four keypoints near the target, at any step. Each step earns [`crate::task::reward`]. The first step that
    /// earns `success_reward` ends the episode.
    #[default]
    Reach,
    /// Free end of the object at the target when the last step ends. The last step earns 1 minus the distance over
    /// `reward_range_m`, at least 0. Earlier steps earn nothing. An episode runs all its steps.
    PlaceTip {
        /// Distance in m of the outermost keypoint from the target at which the reward is zero. A larger range rewards
        /// coarser motions. A smaller range gives an untrained policy no reward to learn from.
        reward_range_m: f64,
    },
}

impl Goal {
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
    /// Step limit of an episode.
    pub steps: usize,
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
}

impl Task {
    /// True if a position (x, z) in m of the end effector, measured or commanded, lies inside the workspace. The plane of
    /// motion is y = 0.
    pub fn allows(&self, [x_m, z_m]: [f64; 2]) -> bool {
        self.workspace.contains(x_m, 0.0, z_m)
    }
}

fn success_reward() -> f64 {
    0.75
}
