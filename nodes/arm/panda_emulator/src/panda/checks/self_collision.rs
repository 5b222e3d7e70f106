//! Self-collision of the arm by capsules.

use crate::panda::chain::{Chain, Frame};
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_4;

/// Capsule fixed to a frame: index of the frame, ends (m) and radius (m).
struct Capsule {
    frame: usize,
    ends: [[f64; 3]; 2],
    radius_m: f64,
}

const fn capsule(frame: usize, from: [f64; 3], to: [f64; 3], radius_m: f64) -> Capsule {
    Capsule { frame, ends: [from, to], radius_m }
}

/// Index of the base among the frames of the capsules. The joints follow.
const BASE: usize = 0;
/// Index of the frame of the hand.
const HAND: usize = 8;
/// Half of the square root of two: link 7 turns its capsules by 45 degrees.
const C: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Coarse capsules of franka_ros, `franka_description/robots/common` (Apache-2.0): those of base and shoulder.
const INNER: [Capsule; 4] = [
    capsule(BASE, [-0.09, 0.0, 0.06], [-0.06, 0.0, 0.06], 0.06),
    capsule(1, [0.0, 0.0, -0.333], [0.0, 0.0, -0.05], 0.06),
    capsule(2, [0.0, 0.0, -0.06], [0.0, 0.0, 0.06], 0.06),
    capsule(3, [0.0, 0.0, -0.22], [0.0, 0.0, -0.07], 0.06),
];
/// Capsules of forearm, wrist and hand. The hand's two are the last.
const OUTER: [Capsule; 7] = [
    capsule(5, [0.0, 0.0, -0.31], [0.0, 0.0, -0.21], 0.06),
    capsule(5, [0.0, 0.08, -0.20], [0.0, 0.08, -0.06], 0.025),
    capsule(6, [0.0, 0.0, -0.07], [0.0, 0.0, 0.01], 0.05),
    capsule(7, [0.0, 0.0, -0.06], [0.0, 0.0, 0.08], 0.04),
    capsule(7, [0.055 * C, 0.055 * C, 0.082], [0.065 * C, 0.065 * C, 0.082], 0.03),
    capsule(HAND, [0.0, -0.05, 0.04], [0.0, 0.05, 0.04], 0.04),
    capsule(HAND, [0.0, -0.05, 0.10], [0.0, 0.05, 0.10], 0.02),
];
/// Number of capsules of the hand.
const HAND_CAPSULES: usize = 2;
/// Number of pairs, `INNER` times `OUTER`.
const PAIRS: usize = INNER.len() * OUTER.len();
/// Decrease of a distance in a cycle that counts as closing, m. Chosen: an arm at rest does not close.
const CLOSING_M: f64 = 1e-6;

/// Check for self-collision.
#[derive(Debug, Clone)]
pub struct SelfCollision {
    /// Distances of the last cycle, m; negative for capsules that overlap, infinite before the first cycle.
    distances_m: [f64; PAIRS],
    outer: usize,
    hand_in_flange: Frame,
}

impl SelfCollision {
    /// Check with or without the capsules of the Franka Hand.
    pub fn new(with_hand: bool) -> Self {
        let (s, c) = (-FRAC_PI_4).sin_cos();
        let mut hand_in_flange = Frame::identity();
        hand_in_flange.rotation.fixed_view_mut::<2, 2>(0, 0).copy_from_slice(&[c, s, -s, c]);
        let outer = OUTER.len() - if with_hand { 0 } else { HAND_CAPSULES };
        Self { distances_m: [f64::INFINITY; PAIRS], outer, hand_in_flange }
    }

    /// Returns true if two links overlap and come closer. An arm that overlaps may move apart.
    pub fn closes(&mut self, chain: &Chain) -> bool {
        let hand = chain.flange.then(&self.hand_in_flange);
        let place = |c: &Capsule| {
            let frame = match c.frame {
                BASE => Frame::identity(),
                HAND => hand,
                joint => chain.joints[joint - 1],
            };
            c.ends.map(|end| frame.at(&Vector3::from(end)))
        };
        let inner: [[Vector3<f64>; 2]; INNER.len()] = std::array::from_fn(|i| place(&INNER[i]));
        let mut closes = false;
        for (k, outer) in OUTER[..self.outer].iter().enumerate() {
            let ends = place(outer);
            for (i, ends_inner) in inner.iter().enumerate() {
                let distance_m = segments_m(ends_inner, &ends) - INNER[i].radius_m - outer.radius_m;
                let before_m = std::mem::replace(&mut self.distances_m[k * INNER.len() + i], distance_m);
                // The forearm's capsule overlaps the upper arm at the elbow, where both meet by construction.
                let neighbours = INNER[i].frame == 3 && outer.frame == 5;
                let closer = before_m.is_finite() && distance_m < before_m - CLOSING_M;
                closes |= !neighbours && distance_m < 0.0 && closer;
            }
        }
        closes
    }
}

/// Distance of two segments, m (Ericson, Real-Time Collision Detection, 5.1.9). The segments have a length.
fn segments_m(a: &[Vector3<f64>; 2], b: &[Vector3<f64>; 2]) -> f64 {
    let (along_a, along_b, between) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (aa, bb, ab) = (along_a.norm_squared(), along_b.norm_squared(), along_a.dot(&along_b));
    let (at_a, at_b) = (along_a.dot(&between), along_b.dot(&between));
    let denominator = aa * bb - ab * ab;
    let parallel = denominator < 1e-12 * aa * bb;
    let s = if parallel { 0.0 } else { ((ab * at_b - at_a * bb) / denominator).clamp(0.0, 1.0) };
    let t = (ab * s + at_b) / bb;
    let (s, t) = if t < 0.0 {
        ((-at_a / aa).clamp(0.0, 1.0), 0.0)
    } else if t > 1.0 {
        (((ab - at_a) / aa).clamp(0.0, 1.0), 1.0)
    } else {
        (s, t)
    };
    (between + along_a * s - along_b * t).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panda::chain::Joints;
    use crate::panda::settings::READY_RAD;

    #[test]
    fn distance_of_crossing_and_parallel_segments() {
        let v = Vector3::new;
        let x = [v(-1.0, 0.0, 0.0), v(1.0, 0.0, 0.0)];
        assert!((segments_m(&x, &[v(0.0, -1.0, 0.5), v(0.0, 1.0, 0.5)]) - 0.5).abs() < 1e-15);
        assert!((segments_m(&x, &[v(-1.0, 0.3, 0.0), v(1.0, 0.3, 0.0)]) - 0.3).abs() < 1e-15);
        assert!((segments_m(&x, &[v(2.0, 0.0, 0.0), v(3.0, 0.0, 0.0)]) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn ready_pose_is_free_and_a_folded_wrist_reaches_the_base() {
        let mut check = SelfCollision::new(true);
        check.closes(&Chain::at(&Joints::from(READY_RAD)));
        let free = check.distances_m.iter().enumerate().filter(|(p, _)| p % INNER.len() != 3);
        let least_m = free.map(|(_, d)| *d).fold(f64::INFINITY, f64::min);
        assert!(least_m > 0.1, "{least_m} m");
        // The arm leans back and folds, which brings the hand to the base.
        let at = |k: u32| {
            let share = f64::from(k) / 1000.0;
            Chain::at(&Joints::from([0.0, 0.2 + 1.2 * share, 0.0, -2.2 - 0.8 * share, 0.0, 1.6 - 1.2 * share, 0.8]))
        };
        let hit = (0..=1000).find(|k| check.closes(&at(*k)));
        assert!(hit.is_some_and(|k| k > 10), "{hit:?}");
        let reached = hit.unwrap();
        assert!(!check.closes(&at(reached)), "an arm at rest does not close");
        assert!(!check.closes(&at(reached - 20)), "the way back is free");
    }
}
