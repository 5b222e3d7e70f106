//! Reward of a position in the goal `reach`.

/// Distance from which on the reward is zero, in scaled image units.
pub(super) const REWARD_RANGE: f64 = 1.5;

/// Reward of a step that left the workspace.
pub const LEFT_WORKSPACE_REWARD: f64 = -1.0;

/// Reward of a position: `max(0, 1 - d / 1.5)`, with `d` the Frobenius norm of the four keypoint-to-target differences
/// in image coordinates scaled to -1 .. 1.
pub fn reward(dlo: &[[f64; 2]; 4], target: [f64; 2]) -> f64 {
    let squared: f64 = dlo.iter().map(|p| (p[0] - target[0]).powi(2) + (p[1] - target[1]).powi(2)).sum();
    (1.0 - squared.sqrt() / REWARD_RANGE).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reward_is_one_on_the_target_and_zero_far_away() {
        assert_eq!(reward(&[[0.2, 0.1]; 4], [0.2, 0.1]), 1.0);
        assert_eq!(reward(&[[1.0, 1.0]; 4], [-1.0, -1.0]), 0.0);
        let r = reward(&[[0.3, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]], [0.0, 0.0]);
        assert!((r - 0.8).abs() < 1e-12, "{r}");
    }
}
