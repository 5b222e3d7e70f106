//! Which pieces of the object belong together across something that stands in front of it.

use catenary_core::LabelMask;
use catenary_core::image::label;
use catenary_core::regions::Regions;

use crate::ColourParams;
use crate::classify::OCCLUDER;
use crate::morphology::Plane;

/// Finds the pieces that lie behind one occluder. Keeps its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Occlusion {
    /// The pixels that something may be hidden behind.
    cover: Plane,
    /// For each pixel, whether the walk has been there.
    seen: Vec<bool>,
    edge: Vec<u32>,
    next_edge: Vec<u32>,
    keep: Vec<bool>,
}

impl Occlusion {
    /// For each region, whether it belongs to the object: the region `main`, and each of at least `min_piece_area_px`
    /// that is reached from a kept one by at most `max_occlusion_px` steps over pixels of the class [`OCCLUDER`] or of
    /// the target.
    pub(crate) fn pieces(
        &mut self,
        classes: &LabelMask,
        regions: &Regions,
        main: usize,
        params: &ColourParams,
    ) -> &[bool] {
        self.keep.clear();
        self.keep.resize(regions.found().len(), false);
        self.keep[main] = true;
        let candidates = regions.found().iter().filter(|r| r.area_px >= params.min_piece_area_px).count();
        if params.max_occlusion_px == 0 || candidates < 2 {
            return &self.keep;
        }
        // Edge pixels have a mixed colour: one pixel of tolerance around the occluder.
        self.cover.load(classes, 0, |class| class == OCCLUDER || class == label::TARGET);
        self.cover.dilate();
        while self.grow([classes.width as usize, classes.height as usize], regions, params) {}
        &self.keep
    }

    /// Walks from the kept regions; whether that reached another one.
    fn grow(&mut self, [width, height]: [usize; 2], regions: &Regions, params: &ColourParams) -> bool {
        self.seen.clear();
        self.seen.resize(width * height, false);
        self.edge.clear();
        for (region, _) in regions.found().iter().zip(&self.keep).filter(|(_, keep)| **keep) {
            self.edge.extend_from_slice(regions.pixels(region));
        }
        let mut reached = false;
        for _ in 0..=params.max_occlusion_px {
            self.next_edge.clear();
            for &pixel in &self.edge {
                let (u, v) = (pixel as usize % width, pixel as usize / width);
                for y in v.saturating_sub(1)..(v + 2).min(height) {
                    for x in u.saturating_sub(1)..(u + 2).min(width) {
                        let near = y * width + x;
                        if let Some(region) = regions.at(near) {
                            let large = regions.found()[region].area_px >= params.min_piece_area_px;
                            reached |= large && !self.keep[region];
                            self.keep[region] |= large;
                        } else if self.cover.row(y)[x] == 1 && !self.seen[near] {
                            self.seen[near] = true;
                            self.next_edge.push(near as u32);
                        }
                    }
                }
            }
            std::mem::swap(&mut self.edge, &mut self.next_edge);
        }
        reached
    }
}
