//! Observation of the policy.

use serde::{Deserialize, Serialize};

/// The 12 numbers of `/policy/observation`: end effector x, z in m, then four keypoints of the object and the target,
/// each (x, y) scaled to -1 .. 1 over the image.
///
/// Trackers give the keypoints as a set. The constructor sorts them top to bottom, then left to right, so a flip of
/// the tracker's order does not change the observation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Observation(pub [f64; Observation::LEN]);

impl Observation {
    /// Number of values of an observation.
    pub const LEN: usize = 12;

    /// Builds an observation from `eef_m` = (x, z) in m, and `dlo` and `target` scaled to -1 .. 1. Sorts the keypoints.
    pub fn new(eef_m: [f64; 2], dlo: &[[f64; 2]; 4], target: [f64; 2]) -> Self {
        let mut order = *dlo;
        // y grows downwards, so the topmost keypoint comes first.
        order.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
        let mut values = [0.0; Self::LEN];
        values[..2].copy_from_slice(&eef_m);
        for (slot, p) in values[2..10].chunks_exact_mut(2).zip(&order) {
            slot.copy_from_slice(p);
        }
        values[10..].copy_from_slice(&target);
        Self(values)
    }

    /// End effector (x, z) in m.
    pub fn eef_m(&self) -> [f64; 2] {
        [self.0[0], self.0[1]]
    }

    /// Four keypoints (x, y), scaled to -1 .. 1 over the image.
    pub fn dlo(&self) -> [[f64; 2]; 4] {
        std::array::from_fn(|k| [self.0[2 + 2 * k], self.0[3 + 2 * k]])
    }

    /// Target (x, y), scaled to -1 .. 1 over the image.
    pub fn target(&self) -> [f64; 2] {
        [self.0[10], self.0[11]]
    }

    /// Reward of the observed position, by [`crate::task::reward`].
    pub fn reward(&self) -> f64 {
        crate::task::reward(&self.dlo(), self.target())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn does_not_depend_on_the_order_of_the_keypoints() {
        let points = [[0.1, 0.5], [0.2, -0.5], [0.3, 0.0], [-0.4, 0.0]];
        let a = Observation::new([0.4, 0.3], &points, [0.0, 0.1]);
        let mut flipped = points;
        flipped.reverse();
        assert_eq!(a, Observation::new([0.4, 0.3], &flipped, [0.0, 0.1]));
        assert_eq!(a.dlo()[1], [-0.4, 0.0]);
        assert_eq!(a.target(), [0.0, 0.1]);
    }
}
