//! Pieces of the object that an occluder separates.

use catenary_core::regions::Regions;

use super::rules::SelectionRules;

/// Search for pieces of the object that lie near one another. Reuses its buffers.
///
/// Whatever lies between two pieces may hide the object: a white hand, a person's arm, a reflection. The tracker decides which piece
/// continues which.
#[derive(Debug, Clone, Default)]
pub(crate) struct Occlusion {
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
    /// `min_piece_area_px` that lies within `max_occlusion_px` of a kept region. `size` is the mask's.
    pub(crate) fn pieces(
        &mut self,
        size: [usize; 2],
        regions: &Regions,
        main: usize,
        rules: &SelectionRules,
    ) -> &[bool] {
        self.keep.clear();
        self.keep.resize(regions.found().len(), false);
        self.keep[main] = true;
        let candidates = regions.found().iter().filter(|r| r.area_px >= rules.min_piece_area_px).count();
        if rules.max_occlusion_px == 0 || candidates < 2 {
            return &self.keep;
        }
        // A piece that was found may lead to a further one: the search starts again from all kept regions.
        while self.grow(size, regions, rules) {}
        &self.keep
    }

    /// Searches from the kept regions. Returns true if it reached another one.
    fn grow(&mut self, [width, height]: [usize; 2], regions: &Regions, rules: &SelectionRules) -> bool {
        self.seen.clear();
        self.seen.resize(width * height, false);
        self.edge.clear();
        for (region, _) in regions.found().iter().zip(&self.keep).filter(|(_, keep)| **keep) {
            self.edge.extend_from_slice(regions.pixels(region));
        }
        let mut reached = false;
        // The search makes `max_occlusion_px` + 1 steps, because the last step enters the other piece.
        for _ in 0..=rules.max_occlusion_px {
            self.next_edge.clear();
            for &pixel in &self.edge {
                let (u, v) = (pixel as usize % width, pixel as usize / width);
                for y in v.saturating_sub(1)..(v + 2).min(height) {
                    for x in u.saturating_sub(1)..(u + 2).min(width) {
                        let near = y * width + x;
                        if let Some(region) = regions.at(near) {
                            let large = regions.found()[region].area_px >= rules.min_piece_area_px;
                            reached |= large && !self.keep[region];
                            self.keep[region] |= large;
                        } else if !self.seen[near] {
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
