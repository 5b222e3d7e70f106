//! Axes of the image along which templates move all keypoints.

/// Axis of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Axis {
    /// To the right.
    Across,
    /// Up.
    Up,
}

impl Axis {
    /// Moves all keypoints by `way`, in half images.
    pub fn shift(self, way: f64, keypoints: &mut [[f64; 2]; 4]) {
        for keypoint in keypoints {
            match self {
                Axis::Across => keypoint[0] += way,
                // Rows are counted downwards.
                Axis::Up => keypoint[1] -= way,
            }
        }
    }
}
