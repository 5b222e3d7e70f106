//! Connected pieces of the object on a grid with an empty frame, one cell wide.

use catenary_core::LabelMask;
use catenary_core::image::label;
use catenary_core::regions::Regions;

use crate::TrackerParams;

/// Most pieces of the object that are tracked, the largest ones.
pub(crate) const MAX_PIECES: usize = 4;

/// Connected piece of the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Piece {
    /// Value of its cells, from 1.
    pub(crate) id: u8,
    /// Area without filled holes.
    pub(crate) area_px: f64,
    pub(crate) centroid_px: [f64; 2],
    /// Unit direction in which the piece is longest.
    pub(crate) axis: [f64; 2],
    /// Extent along the axis from the centroid, backwards (negative) and forwards.
    pub(crate) reach_px: [f64; 2],
}

/// Pieces of one mask. Cell (x, y) is pixel (x − 1, y − 1).
#[derive(Debug, Clone, Default)]
pub(crate) struct Pieces {
    pub(crate) list: Vec<Piece>,
    /// Cells in a row.
    pub(crate) stride: usize,
    /// Id of the piece that holds each cell, 0 outside of all.
    pub(crate) cells: Vec<u8>,
    /// Cells of all pieces in raster order.
    pub(crate) inside: Vec<usize>,
    /// Area labelled as the object, including regions that are no pieces.
    pub(crate) labelled_px: usize,
    /// Indices of the regions, largest first.
    order: Vec<usize>,
    /// Cells of the hole under examination.
    flood: Vec<usize>,
}

impl Pieces {
    /// Loads the largest regions of the object in `mask` and fills their small holes.
    pub(crate) fn load(&mut self, mask: &LabelMask, regions: &mut Regions, params: &TrackerParams) {
        regions.find(mask, label::DLO);
        let found = regions.found();
        self.labelled_px = found.iter().map(|r| r.area_px).sum();
        self.list.clear();
        self.order.clear();
        self.order.extend((0..found.len()).filter(|&i| found[i].area_px >= params.min_piece_area_px));
        self.order.sort_unstable_by_key(|&i| (std::cmp::Reverse(found[i].area_px), i));
        self.order.truncate(MAX_PIECES);
        if self.order.first().is_none_or(|&i| found[i].area_px < params.min_area_px) {
            return;
        }
        let width = mask.width as usize;
        self.stride = width + 2;
        self.cells.clear();
        self.cells.resize(self.stride * (mask.height as usize + 2), 0);
        // Later passes visit the bounding box of the pieces only.
        let mut bounds = [[usize::MAX, 0]; 2];
        for (i, &index) in self.order.iter().enumerate() {
            let (region, id) = (&found[index], i as u8 + 1);
            for &pixel in regions.pixels(region) {
                let (u, v) = (pixel as usize % width, pixel as usize / width);
                self.cells[(v + 1) * self.stride + u + 1] = id;
            }
            for (bounds, found) in bounds.iter_mut().zip([region.columns, region.rows]) {
                *bounds = [bounds[0].min(found[0] + 1), bounds[1].max(found[1] + 1)];
            }
            self.list.push(main_axis(id, region.centroid_px, regions.pixels(region), width));
        }
        self.fill_holes(bounds, params.max_hole_px);
        self.inside.clear();
        for y in bounds[1][0]..=bounds[1][1] {
            let row = y * self.stride;
            let cells = row + bounds[0][0]..=row + bounds[0][1];
            self.inside.extend(cells.filter(|&cell| self.cells[cell] != 0));
        }
    }

    /// Id of the piece at `point` in pixels, 0 outside of all.
    pub(crate) fn at(&self, point: [f64; 2]) -> u8 {
        let (x, y) = (point[0].floor() + 1.0, point[1].floor() + 1.0);
        if !(x >= 0.0 && y >= 0.0 && x < self.stride as f64) {
            return 0;
        }
        self.cells.get(y as usize * self.stride + x as usize).copied().unwrap_or(0)
    }

    /// Centre of a cell in pixels.
    pub(crate) fn centre(&self, cell: usize) -> [f64; 2] {
        [(cell % self.stride) as f64 - 0.5, (cell / self.stride) as f64 - 0.5]
    }

    /// Fills each enclosed 4-connected region of at most `max_px` empty cells. The second argument holds the first and last
    /// column and row of the pieces.
    fn fill_holes(&mut self, [columns, rows]: [[usize; 2]; 2], max_px: usize) {
        for y in rows[0]..=rows[1] {
            for cell in y * self.stride + columns[0]..y * self.stride + columns[1] {
                let around = self.cells[cell];
                // The first cell of a hole has a piece to its left.
                if around != 0 && self.cells[cell + 1] == 0 {
                    self.collect(cell + 1, max_px);
                    let is_hole = self.flood.len() <= max_px && !self.flood.iter().any(|&c| self.is_frame(c));
                    let fill = if is_hole { around } else { 0 };
                    self.flood.iter().for_each(|&c| self.cells[c] = fill);
                }
            }
        }
    }

    /// Returns true for cells of the grid's frame.
    fn is_frame(&self, cell: usize) -> bool {
        let x = cell % self.stride;
        x == 0 || x + 1 == self.stride || cell < self.stride || cell + self.stride >= self.cells.len()
    }

    /// Collects the 4-connected empty cells around `start` in `flood` and marks them, until there are more than `max`.
    fn collect(&mut self, start: usize, max: usize) {
        const MARK: u8 = u8::MAX;
        self.flood.clear();
        self.flood.push(start);
        self.cells[start] = MARK;
        let mut next = 0;
        while let Some(&cell) = self.flood.get(next).filter(|_| self.flood.len() <= max) {
            next += 1;
            for near in [cell.wrapping_sub(1), cell + 1, cell.wrapping_sub(self.stride), cell + self.stride] {
                if self.cells.get(near) == Some(&0) {
                    self.cells[near] = MARK;
                    self.flood.push(near);
                }
            }
        }
    }
}

/// Piece with the main axis of its second moments. The axis of a round region is horizontal.
fn main_axis(id: u8, centroid_px: [f64; 2], pixels: &[u32], width: usize) -> Piece {
    let offset = |pixel: u32| {
        let (u, v) = (pixel as usize % width, pixel as usize / width);
        [u as f64 + 0.5 - centroid_px[0], v as f64 + 0.5 - centroid_px[1]]
    };
    let [mut uu, mut uv, mut vv] = [0.0; 3];
    for d in pixels.iter().map(|&p| offset(p)) {
        (uu, uv, vv) = (uu + d[0] * d[0], uv + d[0] * d[1], vv + d[1] * d[1]);
    }
    let angle = 0.5 * (2.0 * uv).atan2(uu - vv);
    let axis = [angle.cos(), angle.sin()];
    let mut reach_px = [0.0f64; 2];
    for d in pixels.iter().map(|&p| offset(p)) {
        let along = axis[0] * d[0] + axis[1] * d[1];
        // A pixel reaches half its side beyond its centre.
        reach_px = [reach_px[0].min(along - 0.5), reach_px[1].max(along + 0.5)];
    }
    Piece { id, area_px: pixels.len() as f64, centroid_px, axis, reach_px }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(rows: &[&str], max_hole_px: usize) -> Pieces {
        let data = rows.concat().bytes().map(|b| u8::from(b == b'#')).collect();
        let mask = LabelMask::from_data(rows[0].len() as u32, rows.len() as u32, data).unwrap();
        let params = TrackerParams { min_area_px: 1, min_piece_area_px: 1, max_hole_px, ..TrackerParams::default() };
        let mut pieces = Pieces::default();
        pieces.load(&mask, &mut Regions::default(), &params);
        pieces
    }

    #[test]
    fn small_holes_are_filled_and_large_ones_stay() {
        let rows = ["######....", "#.##.#..##", "#.####..##", "######...."];
        let filled = |max| load(&rows, max).cells.iter().filter(|&&c| c == 1).count();
        assert_eq!([filled(0), filled(1), filled(2)], [21, 22, 24]);
        let pieces = load(&rows, 2);
        assert_eq!(pieces.at([1.5, 1.5]), 1);
        assert_eq!(pieces.at([9.0, 1.0]), 2);
        assert_eq!([pieces.at([7.5, 1.5]), pieces.at([-0.1, 0.5]), pieces.at([1.0, 4.0])], [0, 0, 0]);
        assert_eq!(pieces.list[1].centroid_px, [9.0, 2.0]);
    }

    #[test]
    fn the_axis_runs_from_end_to_end() {
        let pieces = load(&["........", ".######.", ".######.", "........"], 0);
        let piece = pieces.list[0];
        assert!((piece.axis[0].abs() - 1.0).abs() < 1e-12);
        assert_eq!(piece.reach_px, [-3.0, 3.0]);
    }
}
