//! What every segmentation backend does.

use catenary_core::{LabelMask, RgbView};

use crate::Error;

/// Finds the object and the target in an image.
pub trait Segmenter {
    /// Labels `image` into `out`, which is resized where it does not have the segmenter's mask size.
    ///
    /// An image in which nothing is found is no error: the mask is background, and the report says so.
    fn segment(&mut self, image: RgbView<'_>, out: &mut LabelMask) -> Result<SegmentationReport, Error>;
}

/// What one mask holds. Areas count mask pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SegmentationReport {
    /// Area labelled as the object; 0 where it was not found.
    pub dlo_area_px: usize,
    /// Number of pieces of the object: more than one where something stands in front of it.
    pub dlo_pieces: usize,
    /// Area labelled as the target; 0 where it was not found.
    pub target_area_px: usize,
    /// Mean (u, v) of the target's pixels in mask pixels, the centre of the first pixel at (0.5, 0.5). Of the visible
    /// part: biased where the target is partly hidden.
    pub target_centroid_px: Option<[f64; 2]>,
    /// Area that has the colour of the object or of the target, and was dropped as too small or as lying apart.
    pub dropped_px: usize,
}
