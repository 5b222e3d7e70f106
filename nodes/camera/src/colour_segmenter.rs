//! Segmentation by colour.

mod classify;
mod morphology;
mod occlusion;
#[cfg(test)]
mod tests;
mod vote;

use catenary_core::image::label;
use catenary_core::regions::Regions;
use catenary_core::{LabelMask, RgbView};

use self::classify::Classifier;
use self::morphology::Plane;
use self::occlusion::Occlusion;
use self::vote::Vote;
use crate::{ColourParams, Error, SegmentationReport, Segmenter};

/// Segmenter by hue and saturation.
///
/// 1. Each pixel of the crop gets a class by its hue, saturation and chroma ([`crate::ColourRange`]).
/// 2. Each mask pixel takes the class that covers most of it.
/// 3. Each label is closed and opened.
/// 4. The largest connected region of each label stays. Of the object, pieces that an occluder cuts off stay as well.
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
    regions: Regions,
    occlusion: Occlusion,
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
            regions: Regions::default(),
            occlusion: Occlusion::default(),
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

    /// Erases the regions of the object that are too small or not connected with the largest one across an occluder.
    fn select_dlo(&mut self, out: &mut LabelMask, report: &mut SegmentationReport) {
        self.regions.find(out, label::DLO);
        let main = self.regions.largest().filter(|(_, r)| r.area_px >= self.params.min_area_px).map(|(i, _)| i);
        let keep = main.map(|main| self.occlusion.pieces(&self.classes, &self.regions, main, &self.params));
        for (i, region) in self.regions.found().iter().enumerate() {
            if keep.is_some_and(|keep| keep[i]) {
                report.dlo_area_px += region.area_px;
                report.dlo_pieces += 1;
            } else {
                report.dropped_px += region.area_px;
                erase(&self.regions, i, out);
            }
        }
    }

    /// Erases all regions of the target but the largest, and also that one if it is too small.
    fn select_target(&mut self, out: &mut LabelMask, report: &mut SegmentationReport) {
        self.regions.find(out, label::TARGET);
        let largest = self.regions.largest().filter(|(_, r)| r.area_px >= self.params.min_area_px).map(|(i, _)| i);
        for (i, region) in self.regions.found().iter().enumerate() {
            if largest == Some(i) {
                report.target_area_px = region.area_px;
                report.target_centroid_px = Some(region.centroid_px);
            } else {
                report.dropped_px += region.area_px;
                erase(&self.regions, i, out);
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
        let mut report = SegmentationReport::default();
        self.select_dlo(out, &mut report);
        self.select_target(out, &mut report);
        Ok(report)
    }
}

/// Sets the pixels of one region to background.
fn erase(regions: &Regions, index: usize, out: &mut LabelMask) {
    for &pixel in regions.pixels(&regions.found()[index]) {
        out.data[pixel as usize] = label::BACKGROUND;
    }
}
