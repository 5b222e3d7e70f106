//! The policy's observation.

use serde::{Deserialize, Serialize};

/// The 12 numbers of the contract: end effector x, z in m; then four keypoints of the object and the target, each
/// (x, y) in the image scaled to -1 .. 1.
///
/// Trackers give the keypoints as a set. Here they are put into a fixed order (top to bottom, then left to right), so
/// that a flip of the tracker's order does not change the observation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Observation(pub [f64; Observation::LEN]);

impl Observation {
    /// Length of an observation.
    pub const LEN: usize = 12;

    /// Puts an observation together: `eef_m` = (x, z) in m, `dlo` and `target` scaled to -1 .. 1.
    pub fn new(eef_m: [f64; 2], dlo: &[[f64; 2]; 4], target: [f64; 2]) -> Self {
        let mut order = *dlo;
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

    /// The four keypoints, scaled.
    pub fn dlo(&self) -> [[f64; 2]; 4] {
        std::array::from_fn(|k| [self.0[2 + 2 * k], self.0[3 + 2 * k]])
    }

    /// The target, scaled.
    pub fn target(&self) -> [f64; 2] {
        [self.0[10], self.0[11]]
    }

    /// Reward of the position that was observed, by [`crate::task::reward`].
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
