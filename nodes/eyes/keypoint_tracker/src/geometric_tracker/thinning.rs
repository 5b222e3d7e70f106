//! Thinning of pieces to lines of one pixel.
//!
//! Border cells are removed from the four sides in turn. A cell goes if that changes no topology (the cell is simple, by the
//! connectivity number of Yokoi, 1973) and shortens no line (the cell is no end). Taking turns keeps the skeleton near the
//! medial axis. Testing one cell after the other keeps a line of even width from vanishing.

use super::pieces::Pieces;

/// Thinning. Reuses its buffers.
#[derive(Debug, Clone)]
pub(crate) struct Thinning {
    /// True for each cell that is left.
    pub(crate) left: Vec<bool>,
    /// Cells that are left, in raster order.
    pub(crate) cells: Vec<usize>,
    candidates: Vec<usize>,
    /// True for each neighbourhood whose middle can go: it is simple and no end.
    removable: Vec<bool>,
}

impl Default for Thinning {
    fn default() -> Self {
        let removable = (0..=u8::MAX).map(|around| is_simple(around) && around.count_ones() >= 2).collect();
        Self { left: vec![], cells: vec![], candidates: vec![], removable }
    }
}

impl Thinning {
    /// Thins the pieces whose id satisfies `wanted` until no cell can go.
    pub(crate) fn thin(&mut self, pieces: &Pieces, wanted: impl Fn(u8) -> bool) {
        self.cells.clear();
        self.cells.extend(pieces.inside.iter().copied().filter(|&cell| wanted(pieces.cells[cell])));
        self.left.clear();
        self.left.resize(pieces.cells.len(), false);
        for &cell in &self.cells {
            self.left[cell] = true;
        }
        let around = neighbours(pieces.stride);
        loop {
            let before = self.cells.len();
            // Up, down, right, left.
            for side in [2, 6, 0, 4] {
                self.take_from(&around, side);
            }
            if self.cells.len() == before {
                return;
            }
        }
    }

    /// Removes the cells that can go and whose neighbour on `side` was empty before this call.
    fn take_from(&mut self, around: &[isize; 8], side: usize) {
        let (left, candidates) = (&mut self.left, &mut self.candidates);
        candidates.clear();
        candidates.extend(self.cells.iter().copied().filter(|&cell| {
            !left[cell.wrapping_add_signed(around[side])] && self.removable[usize::from(bits(left, cell, around))]
        }));
        for &cell in &*candidates {
            // An earlier removal of this pass may have made the cell indispensable.
            if self.removable[usize::from(bits(left, cell, around))] {
                left[cell] = false;
            }
        }
        self.cells.retain(|&cell| left[cell]);
    }
}

/// Offsets of the eight neighbours, counter-clockwise from the right one.
pub(crate) fn neighbours(stride: usize) -> [isize; 8] {
    let s = stride as isize;
    [1, 1 - s, -s, -1 - s, -1, s - 1, s, s + 1]
}

/// Bit mask of the neighbours that are set, in the order of [`neighbours`].
pub(crate) fn bits(set: &[bool], cell: usize, around: &[isize; 8]) -> u8 {
    around.iter().enumerate().fold(0, |bits, (k, &d)| bits | u8::from(set[cell.wrapping_add_signed(d)]) << k)
}

/// Returns true if removing the middle of the neighbourhood changes no topology: its 8-connectivity number is 1.
fn is_simple(around: u8) -> bool {
    // Yokoi's sum over the side neighbours k, with x = 1 for an empty cell: x(k) - x(k) x(k + 1) x(k + 2).
    let empty = |k: u32| 1 - i32::from(around.rotate_right(k % 8) & 1);
    [0, 2, 4, 6].into_iter().map(|k| empty(k) - empty(k) * empty(k + 1) * empty(k + 2)).sum::<i32>() == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrackerParams;
    use catenary_core::LabelMask;
    use catenary_core::regions::Regions;

    fn thin(mask: &LabelMask) -> LabelMask {
        let params = TrackerParams { min_area_px: 1, min_piece_area_px: 1, max_hole_px: 0, ..TrackerParams::default() };
        let (mut pieces, mut thinning) = (Pieces::default(), Thinning::default());
        pieces.load(mask, &mut Regions::default(), &params);
        thinning.thin(&pieces, |_| true);
        let mut out = LabelMask::new(mask.width, mask.height);
        for &cell in &thinning.cells {
            let [u, v] = pieces.centre(cell).map(|c| c as usize);
            out.data[v * mask.width as usize + u] = 1;
        }
        out
    }

    fn box_mask(columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> LabelMask {
        let mut mask = LabelMask::new(40, 40);
        rows.for_each(|v| columns.clone().for_each(|u| mask.data[v * 40 + u] = 1));
        mask
    }

    #[test]
    fn bars_of_any_width_thin_to_a_line_half_a_width_short_of_each_end() {
        for width in 1..=7 {
            for upright in [false, true] {
                let (long, across) = (5..35, 20..20 + width);
                let mask = if upright { box_mask(across, long) } else { box_mask(long, across) };
                let line = thin(&mask).data.iter().filter(|&&l| l == 1).count();
                assert!((30 - width..=30).contains(&line), "width {width}, upright {upright}: {line} cells");
            }
        }
    }

    #[test]
    fn a_hole_survives_thinning() {
        let mut ring = box_mask(5..30, 5..30);
        (12..20).for_each(|v| (12..20).for_each(|u| ring.data[v * 40 + u] = 0));
        let thin = thin(&ring);
        let mut regions = Regions::default();
        assert_eq!(regions.find(&thin, 1).len(), 1);
        // Holes are 4-connected: an 8-connected background would leak through the corners of a ring one pixel wide.
        let (mut pieces, all) =
            (Pieces::default(), TrackerParams { min_area_px: 1, max_hole_px: 10_000, ..TrackerParams::default() });
        pieces.load(&thin, &mut regions, &all);
        let filled = pieces.cells.iter().filter(|&&c| c == 1).count();
        assert!(filled > 100, "the hole is gone: {filled} cells");
    }

    #[test]
    fn a_cell_is_simple_when_its_neighbours_hang_together_without_it() {
        assert!(!is_simple(0), "alone");
        assert!(!is_simple(u8::MAX), "inside");
        assert!(!is_simple(0b0001_0001), "a bridge");
        assert!(is_simple(0b0000_0001) && is_simple(0b0000_0111) && is_simple(0b0000_0010));
    }
}
