//! Rules of the choice of regions.

/// Rules of the choice, in mask pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SelectionRules {
    /// Least area of the object and of the target.
    pub(crate) min_area_px: usize,
    /// Largest distance between two pieces of the object.
    pub(crate) max_occlusion_px: u32,
    /// Least area of a further piece.
    pub(crate) min_piece_area_px: usize,
}
