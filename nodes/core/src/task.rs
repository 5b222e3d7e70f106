//! The task: bring the object to the target, inside the workspace.

mod judge;

pub use judge::{Judge, Moment, Verdict};

use serde::{Deserialize, Serialize};

/// Limits of an action: |dx|, |dz| in m.
pub const MAX_DELTA_M: f64 = 0.06;

/// What a delta of the end effector is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeltaAnchor {
    /// The measured pose: a soft or slow arm then achieves less than was asked for.
    Measured,
    /// The previous target: deltas add up exactly.
    #[default]
    LastTarget,
}

/// The box that the end effector may move in, frame panda_link0, m.
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
    /// Whether the point (m) lies inside.
    pub fn contains(&self, x_m: f64, y_m: f64, z_m: f64) -> bool {
        let inside = |v: f64, [low, high]: [f64; 2]| (low..=high).contains(&v);
        inside(x_m, self.x_m) && inside(y_m, self.y_m) && inside(z_m, self.z_m)
    }
}

/// Goal of a task: which part of the object has to be where, and when.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Goal {
    /// All four keypoints near the target, at any step. Each step earns [`reward`]; an episode ends with the first step
    /// that earns `success_reward`.
    #[default]
    Reach,
    /// The object's free end at the target when the last step ends. The last step earns 1 minus the distance over
    /// `reward_range_m`, at least 0; the steps before it earn nothing. An episode runs all its steps.
    PlaceTip {
        /// Distance in m of the outermost keypoint from the target at which the reward is zero. Larger rewards coarser
        /// motions; smaller gives a beginner nothing to learn from.
        reward_range_m: f64,
    },
}

impl Goal {
    /// Whether it is the default.
    fn is_reach(&self) -> bool {
        *self == Self::Reach
    }
}

/// The task of the contract.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// What has to be achieved.
    #[serde(default, skip_serializing_if = "Goal::is_reach")]
    pub goal: Goal,
    /// Step limit of an episode.
    pub steps: usize,
    /// s between two actions.
    pub step_period_s: f64,
    /// What a delta is added to.
    pub delta_anchor: DeltaAnchor,
    /// The box of the end effector; leaving it ends the episode with reward -1.
    #[serde(default)]
    pub workspace: Workspace,
    /// (x, z) in m of the target's centre, frame panda_link0.
    pub target_m: [f64; 2],
    /// Half width in m of the uniform jitter of the target, in x and in z.
    pub target_jitter_m: f64,
    /// Reward at and above which a step is a success.
    #[serde(default = "success_reward")]
    pub success_reward: f64,
}

fn success_reward() -> f64 {
    0.75
}

/// Distance at and beyond which the reward is zero, in scaled image units.
const REWARD_RANGE: f64 = 1.5;

/// Reward of a position: `1 - d / 1.5` where `d <= 1.5`, else 0, with `d` the Frobenius norm of the four
/// keypoint-to-target differences, all in image coordinates scaled to -1 .. 1.
pub fn reward(dlo: &[[f64; 2]; 4], target: [f64; 2]) -> f64 {
    let squared: f64 = dlo.iter().map(|p| (p[0] - target[0]).powi(2) + (p[1] - target[1]).powi(2)).sum();
    (1.0 - squared.sqrt() / REWARD_RANGE).max(0.0)
}

/// Reward of a step that left the workspace.
pub const LEFT_WORKSPACE_REWARD: f64 = -1.0;

#[cfg(test)]
mod tests {
    use super::*;

    pub fn task() -> Task {
        Task {
            goal: Goal::Reach,
            steps: 16,
            step_period_s: 0.5,
            delta_anchor: DeltaAnchor::LastTarget,
            workspace: Workspace::default(),
            target_m: [0.5, 0.15],
            target_jitter_m: 0.0,
            success_reward: 0.75,
        }
    }

    #[test]
    fn reward_is_one_on_the_target_and_zero_far_away() {
        assert_eq!(reward(&[[0.2, 0.1]; 4], [0.2, 0.1]), 1.0);
        assert_eq!(reward(&[[1.0, 1.0]; 4], [-1.0, -1.0]), 0.0);
        let r = reward(&[[0.3, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]], [0.0, 0.0]);
        assert!((r - 0.8).abs() < 1e-12, "{r}");
    }
}
