//! Contents of the masks of the last moments, and doubts about them.

use crate::SegmentationReport;

/// Least share of images in which the object should be found.
const LEAST_FOUND: f64 = 0.9;
/// Largest share of the mask that a thin object covers.
const MOST_COVERED: f64 = 0.25;
/// Largest number of pieces that the tracker joins.
const MOST_PIECES: f64 = 4.0;

/// Sums over the masks since the last summary.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sight {
    images: usize,
    found: usize,
    pieces: usize,
    object_px: usize,
    target: usize,
    dropped_px: usize,
    mask_px: usize,
}

/// Means over some masks.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Number of masks.
    pub images: usize,
    /// Share of masks with the object.
    pub found: f64,
    /// Pieces of the object in a mask that has it.
    pub pieces: f64,
    /// Share of the mask that is the object.
    pub object: f64,
    /// Share of masks with the target.
    pub target: f64,
    /// Share of the mask with the colour of object or target that was dropped.
    pub dropped: f64,
    /// Doubts about implausible values, in words; empty if there are none.
    pub doubts: Vec<String>,
}

impl Sight {
    /// Adds a mask of `mask_px` pixels.
    pub fn add(&mut self, report: &SegmentationReport, mask_px: usize) {
        self.images += 1;
        self.found += usize::from(report.dlo_area_px > 0);
        self.pieces += report.dlo_pieces;
        self.object_px += report.dlo_area_px;
        self.target += usize::from(report.target_area_px > 0);
        self.dropped_px += report.dropped_px;
        self.mask_px += mask_px;
    }

    /// Means since the last call; none without a mask.
    pub fn take(&mut self) -> Option<Summary> {
        let sums = std::mem::take(self);
        if sums.images == 0 {
            return None;
        }
        let of = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        let mut summary = Summary {
            images: sums.images,
            found: of(sums.found, sums.images),
            pieces: of(sums.pieces, sums.found),
            object: of(sums.object_px, sums.mask_px),
            target: of(sums.target, sums.images),
            dropped: of(sums.dropped_px, sums.mask_px),
            doubts: Vec::new(),
        };
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let mut doubt = |is_so: bool, words: String| summary.doubts.extend(is_so.then_some(words));
        let (found, covered, pieces) = (summary.found, summary.object, summary.pieces);
        doubt(found < LEAST_FOUND, format!("the object is in {} of the images: check its colours", percent(found)));
        doubt(
            covered > MOST_COVERED,
            format!("{} of the mask is the object: something else has its colours", percent(covered)),
        );
        doubt(
            pieces > MOST_PIECES,
            format!("{pieces:.1} pieces of the object: its colours are too narrow, or others have them"),
        );
        let is_more = sums.dropped_px > sums.object_px && sums.found > 0;
        doubt(
            is_more,
            format!(
                "more was dropped ({}) than kept ({}): another thing has the object's colours",
                percent(summary.dropped),
                percent(covered)
            ),
        );
        Some(summary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: SegmentationReport = SegmentationReport {
        dlo_area_px: 600,
        dlo_pieces: 1,
        target_area_px: 50,
        target_centroid_px: None,
        dropped_px: 9,
        certainty: 1.0,
    };

    fn doubts(reports: &[SegmentationReport]) -> Vec<String> {
        let mut sight = Sight::default();
        reports.iter().for_each(|r| sight.add(r, 65_536));
        sight.take().unwrap().doubts
    }

    #[test]
    fn a_summary_holds_means_and_starts_anew() {
        let mut sight = Sight::default();
        assert_eq!(sight.take(), None);
        sight.add(&GOOD, 65_536);
        sight.add(&SegmentationReport { dlo_pieces: 3, target_area_px: 0, ..GOOD }, 65_536);
        let summary = sight.take().unwrap();
        assert_eq!((summary.images, summary.found, summary.pieces, summary.target), (2, 1.0, 2.0, 0.5));
        assert!((summary.object - 600.0 / 65_536.0).abs() < 1e-12 && summary.doubts.is_empty(), "{summary:?}");
        assert_eq!(sight.take(), None);
    }

    #[test]
    fn what_cannot_be_the_object_is_doubted() {
        let none = SegmentationReport { dropped_px: 0, ..SegmentationReport::default() };
        for (report, words) in [
            (none, "0 % of the images"),
            (SegmentationReport { dlo_area_px: 20_000, ..GOOD }, "31 % of the mask"),
            (SegmentationReport { dlo_pieces: 9, ..GOOD }, "9.0 pieces"),
            (SegmentationReport { dropped_px: 700, ..GOOD }, "more was dropped"),
        ] {
            let doubts = doubts(&[report]);
            assert!(doubts.len() == 1 && doubts[0].contains(words), "{words}: {doubts:?}");
        }
        assert_eq!(doubts(&[GOOD; 20]), Vec::<String>::new());
    }
}
