//! Choice of the regions of a mask that are the object and the target.

mod occlusion;
mod rules;

use catenary_core::LabelMask;
use catenary_core::image::label;
use catenary_core::regions::Regions;

use self::occlusion::Occlusion;
pub(crate) use self::rules::SelectionRules;
use crate::SegmentationReport;

/// Choice of regions. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Selection {
    regions: Regions,
    occlusion: Occlusion,
}

impl Selection {
    /// Erases all but the object, in all its pieces, and the target.
    pub(crate) fn select(&mut self, out: &mut LabelMask, rules: &SelectionRules) -> SegmentationReport {
        let mut report = SegmentationReport { certainty: 1.0, ..SegmentationReport::default() };
        self.select_dlo(out, rules, &mut report);
        self.select_target(out, rules, &mut report);
        report
    }

    /// Erases the regions of the object that are too small or too far from the others.
    fn select_dlo(&mut self, out: &mut LabelMask, rules: &SelectionRules, report: &mut SegmentationReport) {
        self.regions.find(out, label::DLO);
        let main = self.regions.largest().filter(|(_, r)| r.area_px >= rules.min_area_px).map(|(i, _)| i);
        let size = [out.width, out.height].map(|s| s as usize);
        let keep = main.map(|main| self.occlusion.pieces(size, &self.regions, main, rules));
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
    fn select_target(&mut self, out: &mut LabelMask, rules: &SelectionRules, report: &mut SegmentationReport) {
        self.regions.find(out, label::TARGET);
        let largest = self.regions.largest().filter(|(_, r)| r.area_px >= rules.min_area_px).map(|(i, _)| i);
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

/// Sets the pixels of one region to background.
fn erase(regions: &Regions, index: usize, out: &mut LabelMask) {
    for &pixel in regions.pixels(&regions.found()[index]) {
        out.data[pixel as usize] = label::BACKGROUND;
    }
}
