//! Segmentation by colour.

mod classify;
mod morphology;
#[cfg(test)]
mod tests;
mod vote;

use catenary_core::image::label;
use catenary_core::{LabelMask, RgbView};

use self::classify::Classifier;
pub(crate) use self::classify::Sector;
use self::morphology::Plane;
use self::vote::Vote;
use crate::selection::Selection;
use crate::{ColourParams, Error, SegmentationReport, Segmenter};

/// Segmenter by hue and saturation.
///
/// 1. Each pixel of the crop gets a class by its hue, saturation and chroma ([`crate::ColourRange`]).
/// 2. Each mask pixel takes the class that covers most of it.
/// 3. Each label is closed and opened.
/// 4. The largest connected region of each label stays. Of the object, pieces near it stay as well, whatever lies between.
///
/// A mask depends on its image alone, not on earlier images. After the first image of a size nothing is allocated,
/// unless a mask has more regions or labelled pixels than any before.
#[derive(Debug, Clone)]
pub struct ColourSegmenter {
    params: ColourParams,
    classifier: Classifier,
    vote: Vote,
    classes: LabelMask,
    plane: Plane,
    selection: Selection,
}

impl ColourSegmenter {
    /// Builds a segmenter.
    ///
    /// # Errors
    /// [`Error::Parameter`] if a parameter is out of range.
    pub fn new(params: ColourParams) -> Result<Self, Error> {
        params.check()?;
        Ok(Self {
            params,
            classifier: Classifier::new(&params),
            vote: Vote::default(),
            classes: LabelMask::new(params.mask_size_px, params.mask_size_px),
            plane: Plane::default(),
            selection: Selection::default(),
        })
    }

    /// Parameters in use.
    pub fn params(&self) -> &ColourParams {
        &self.params
    }

    /// Closes and opens the voted pixels of `label` and writes the result to `out`.
    fn clean(&mut self, label: u8, out: &mut LabelMask) {
        let width = self.classes.width as usize;
        self.plane.load(&self.classes, self.params.close_radius_px, |class| class == label);
        self.plane.close(self.params.close_radius_px);
        self.plane.open(self.params.open_radius_px);
        let rows = out.data.chunks_exact_mut(width).zip(self.classes.data.chunks_exact(width));
        for (v, (out, classes)) in rows.enumerate() {
            for ((out, &class), &set) in out.iter_mut().zip(classes).zip(self.plane.row(v)) {
                // A pixel that was voted for the other label keeps it: closing must not grow one label over the other.
                let is_free = class == label || (class != label::DLO && class != label::TARGET);
                if set == 1 && is_free {
                    *out = label;
                }
            }
        }
    }
}

impl Segmenter for ColourSegmenter {
    fn segment(&mut self, image: RgbView<'_>, out: &mut LabelMask) -> Result<SegmentationReport, Error> {
        let size = self.params.mask_size_px;
        self.vote.vote(&self.classifier, image, self.params.crop, &mut self.classes)?;
        (out.width, out.height) = (size, size);
        out.data.clear();
        out.data.resize(size as usize * size as usize, label::BACKGROUND);
        self.clean(label::DLO, out);
        self.clean(label::TARGET, out);
        Ok(self.selection.select(out, &self.params.selection()))
    }
}
