//! Keypoints of one label mask.

use serde::{Deserialize, Serialize};

/// Keypoints of the deformable object and of the target in one mask.
///
/// Pixel coordinates: u to the right, v down, the centre of the first pixel at (0.5, 0.5). The four keypoints are a set:
/// their order may flip between frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Keypoints {
    /// (u, v) of the object's four keypoints, in pixels.
    pub dlo_px: [[f64; 2]; 4],
    /// (u, v) of the target's centre in pixels, where it was seen.
    pub target_px: Option<[f64; 2]>,
    /// Confidence of each keypoint, 0 to 1; 0 where it was not seen.
    pub scores: [f32; 4],
    /// Confidence of the target, 0 to 1.
    pub target_score: f32,
    /// Width of the mask in pixels.
    pub image_width_px: u32,
    /// Height of the mask in pixels.
    pub image_height_px: u32,
}

impl Keypoints {
    /// `point` in pixels, scaled to -1 .. 1 over the image (x to the right, y down).
    pub fn scaled(&self, point: [f64; 2]) -> [f64; 2] {
        [2.0 * point[0] / f64::from(self.image_width_px) - 1.0, 2.0 * point[1] / f64::from(self.image_height_px) - 1.0]
    }

    /// The four keypoints, scaled to -1 .. 1.
    pub fn dlo_scaled(&self) -> [[f64; 2]; 4] {
        self.dlo_px.map(|p| self.scaled(p))
    }

    /// The target, scaled to -1 .. 1, where it was seen.
    pub fn target_scaled(&self) -> Option<[f64; 2]> {
        self.target_px.map(|p| self.scaled(p))
    }

    /// Whether all four keypoints of the object were seen.
    pub fn dlo_seen(&self) -> bool {
        self.scores.iter().all(|&s| s > 0.0)
    }
}
