//! Sizes of the networks' planes.

/// Side of the input in pixels.
pub(super) const SIDE: usize = 64;
/// Side of a heat map in cells.
pub(super) const CELLS: usize = 16;
/// Number of heat maps: one for each keypoint.
pub(super) const KEYPOINTS: usize = 4;

/// Place of the middle of a cell, from -1 to 1.
pub(super) fn middle(cell: usize) -> f32 {
    (2 * cell + 1) as f32 / CELLS as f32 - 1.0
}
