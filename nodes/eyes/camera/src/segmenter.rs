//! Interface of segmentation backends.

use catenary_core::{LabelMask, RgbView};

use crate::Error;

/// Segmentation of an image into object, target and background.
pub trait Segmenter {
    /// Writes the labels of `image` to `out`, which is resized to the segmenter's mask size.
    ///
    /// An image without object and target is no error: the mask is background, and the report holds zero areas.
    ///
    /// # Errors
    /// [`Error::CropOutside`] or [`Error::Parameter`] if the crop does not fit the image.
    fn segment(&mut self, image: RgbView<'_>, out: &mut LabelMask) -> Result<SegmentationReport, Error>;
}

/// Contents of one mask. Areas are in mask pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SegmentationReport {
    /// Area labelled as the object; 0 if it was not found.
    pub dlo_area_px: usize,
    /// Number of pieces of the object, more than one behind an occluder.
    pub dlo_pieces: usize,
    /// Area labelled as the target; 0 if it was not found.
    pub target_area_px: usize,
    /// Mean (u, v) of the target's visible pixels in mask pixels; the centre of the first pixel is at (0.5, 0.5). Biased if
    /// the target is partly hidden.
    pub target_centroid_px: Option<[f64; 2]>,
    /// Area with the colour of the object or of the target that was dropped because it is too small or lies apart.
    pub dropped_px: usize,
    /// Intersection over union of the object's mask with the object that the segmenter expects by its probabilities, 0 to 1. Always 1 for
    /// segmenters without probabilities.
    pub certainty: f32,
}
