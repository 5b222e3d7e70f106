//! Keypoints of one label mask, and the order in which they may come.

use crate::image::LabelMask;
use crate::model::DriveKind;
use serde::{Deserialize, Serialize};

/// Keypoints of the deformable object and of the target in one mask.
///
/// Pixel coordinates: u to the right, v down, the centre of the first pixel at (0.5, 0.5). The four keypoints are a
/// set: their order may flip between frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Keypoints {
    /// (u, v) of the object's four keypoints, in pixels.
    pub dlo_px: [[f64; 2]; 4],
    /// (u, v) of the target's centre in pixels; none if it was not seen.
    pub target_px: Option<[f64; 2]>,
    /// Confidence of each keypoint, 0 to 1; 0 if it was not seen.
    pub scores: [f32; 4],
    /// Confidence of the target, 0 to 1.
    pub target_score: f32,
    /// Width of the mask in pixels.
    pub image_width_px: u32,
    /// Height of the mask in pixels.
    pub image_height_px: u32,
}

impl Keypoints {
    /// Keypoints of a mask in which the object is not seen: in the middle, with scores of 0. `target` is the target's centre in pixels
    /// with its confidence.
    #[must_use]
    pub fn unseen(mask: &LabelMask, target: Option<([f64; 2], f32)>) -> Self {
        let middle = [mask.width, mask.height].map(|s| 0.5 * f64::from(s));
        Self {
            dlo_px: [middle; 4],
            target_px: target.map(|(centre, _)| centre),
            scores: [0.0; 4],
            target_score: target.map_or(0.0, |(_, score)| score),
            image_width_px: mask.width,
            image_height_px: mask.height,
        }
    }

    /// Converts `point` from pixels to -1 .. 1 over the image (x to the right, y down).
    pub fn scaled(&self, point: [f64; 2]) -> [f64; 2] {
        [2.0 * point[0] / f64::from(self.image_width_px) - 1.0, 2.0 * point[1] / f64::from(self.image_height_px) - 1.0]
    }

    /// Four keypoints, scaled to -1 .. 1.
    pub fn dlo_scaled(&self) -> [[f64; 2]; 4] {
        self.dlo_px.map(|p| self.scaled(p))
    }

    /// Target, scaled to -1 .. 1; none if it was not seen.
    pub fn target_scaled(&self) -> Option<[f64; 2]> {
        self.target_px.map(|p| self.scaled(p))
    }

    /// True if all four keypoints of the object were seen.
    pub fn dlo_seen(&self) -> bool {
        self.scores.iter().all(|&s| s > 0.0)
    }
}

/// Knowledge about the order of a frame's four keypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum KeypointOrder {
    /// Along the object, from either end, as trackers follow it.
    Along,
    /// Unknown: a policy's observation sorts them by their place in the image.
    Unknown,
}

impl KeypointOrder {
    /// Keypoint order of the frames of an episode with this drive.
    pub fn of(drive: DriveKind) -> Self {
        match drive {
            DriveKind::Grip => KeypointOrder::Along,
            DriveKind::Actions | DriveKind::Policy => KeypointOrder::Unknown,
        }
    }

    /// Matches predicted keypoints to seen keypoints: entry k is the index in `seen` of predicted keypoint k.
    ///
    /// `predicted` is in order from the grip on. The match is the possible order with the least sum of squared
    /// distances.
    pub fn closest(self, seen: &[[f64; 2]; 4], predicted: &[[f64; 2]; 4]) -> [usize; 4] {
        let all: &[[usize; 4]] = match self {
            KeypointOrder::Along => &[[0, 1, 2, 3], [3, 2, 1, 0]],
            KeypointOrder::Unknown => &ORDERS,
        };
        let squares: [[f64; 4]; 4] = predicted.map(|p| seen.map(|q| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)));
        let distance = |order: &[usize; 4]| -> f64 { (0..4).map(|k| squares[k][order[k]]).sum() };
        let mut best = (all[0], distance(&all[0]));
        for order in &all[1..] {
            let there = distance(order);
            if there < best.1 {
                best = (*order, there);
            }
        }
        best.0
    }
}

/// All 24 permutations of four indices, in lexicographic order.
pub(crate) const ORDERS: [[usize; 4]; 24] = orders();

const fn orders() -> [[usize; 4]; 24] {
    let mut all = [[0; 4]; 24];
    let (mut number, mut code) = (0, 0);
    while code < 256 {
        // The four base-4 digits of `code`; a permutation has each digit once.
        let order = [code / 64, code / 16 % 4, code / 4 % 4, code % 4];
        if (1 << order[0]) | (1 << order[1]) | (1 << order[2]) | (1 << order[3]) == 0b1111 {
            all[number] = order;
            number += 1;
        }
        code += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOLDED: [[f64; 2]; 4] = [[0.0, 0.4], [0.1, 0.0], [0.2, 0.01], [0.1, 0.02]];

    #[test]
    fn keypoints_that_were_sorted_find_their_places_again() {
        let order = KeypointOrder::of(DriveKind::Actions);
        for shuffled in ORDERS {
            let seen = shuffled.map(|k| [FOLDED[k][0] + 0.002, FOLDED[k][1] - 0.001]);
            let places = order.closest(&seen, &FOLDED);
            assert_eq!(places.map(|place| shuffled[place]), [0, 1, 2, 3], "{shuffled:?}");
        }
    }

    #[test]
    fn a_tracker_begins_at_either_end_and_leaves_nothing_out() {
        let order = KeypointOrder::of(DriveKind::Grip);
        let mut seen = FOLDED;
        assert_eq!(order.closest(&seen, &FOLDED), [0, 1, 2, 3]);
        seen.reverse();
        assert_eq!(order.closest(&seen, &FOLDED), [3, 2, 1, 0]);
        seen.swap(0, 2);
        assert_eq!(order.closest(&seen, &FOLDED), [3, 2, 1, 0], "points that crossed are an error of the model");
    }
}
