//! Pieces of the object that an occluder separates.

use catenary_core::LabelMask;
use catenary_core::image::label;
use catenary_core::regions::Regions;

use super::classify::OCCLUDER;
use super::morphology::Plane;
use crate::ColourParams;

/// Search for pieces of the object that are connected across an occluder. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Occlusion {
    /// Pixels that may hide a part of the object.
    cover: Plane,
    /// True for each pixel that the search has visited.
    seen: Vec<bool>,
    /// Frontier of the breadth-first search.
    edge: Vec<u32>,
    next_edge: Vec<u32>,
    /// True for each region that belongs to the object.
    keep: Vec<bool>,
}

impl Occlusion {
    /// Returns for each region whether it belongs to the object. The region `main` does. So does each region of at least
    /// `min_piece_area_px` that a kept region reaches in at most `max_occlusion_px` steps over pixels of the class
    /// [`OCCLUDER`] or of the target.
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
        // Pixels on the occluder's edge have a mixed colour and no class: the cover is one pixel larger.
        self.cover.load(classes, 0, |class| class == OCCLUDER || class == label::TARGET);
        self.cover.dilate();
        // A piece that was found may lead to a further one: the search starts again from all kept regions.
        while self.grow([classes.width as usize, classes.height as usize], regions, params) {}
        &self.keep
    }

    /// Searches from the kept regions. Returns true if it reached another one.
    fn grow(&mut self, [width, height]: [usize; 2], regions: &Regions, params: &ColourParams) -> bool {
        self.seen.clear();
        self.seen.resize(width * height, false);
        self.edge.clear();
        for (region, _) in regions.found().iter().zip(&self.keep).filter(|(_, keep)| **keep) {
            self.edge.extend_from_slice(regions.pixels(region));
        }
        let mut reached = false;
        // The search makes `max_occlusion_px` + 1 steps, because the last step enters the other piece.
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
