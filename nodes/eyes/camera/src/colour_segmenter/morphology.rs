//! Binary morphology. The structuring element is a cross of five pixels; r repetitions make a diamond of radius r.

use catenary_core::LabelMask;

/// One label as a plane of 0 and 1. A frame around it spares the neighbourhoods every bounds check.
#[derive(Debug, Clone, Default)]
pub(crate) struct Plane {
    width: usize,
    height: usize,
    /// Width of the frame, larger than the radius of a closing.
    frame: usize,
    cells: Vec<u8>,
    scratch: Vec<u8>,
}

impl Plane {
    /// Loads the pixels whose class satisfies `is_set`. `radius` is the largest radius of a later [`Self::close`].
    pub(crate) fn load(&mut self, classes: &LabelMask, radius: u32, is_set: impl Fn(u8) -> bool) {
        let (width, height) = (classes.width as usize, classes.height as usize);
        (self.width, self.height, self.frame) = (width, height, radius as usize + 1);
        // Stale values may stay in the frame: every operation fills it first.
        self.cells.resize(self.stride() * (height + 2 * self.frame), 0);
        self.scratch.resize(self.cells.len(), 0);
        for (v, row) in classes.data.chunks_exact(width).enumerate() {
            let start = self.start(v);
            for (cell, &class) in self.cells[start..].iter_mut().zip(row) {
                *cell = u8::from(is_set(class));
            }
        }
    }

    /// Row `v` without its frame.
    pub(crate) fn row(&self, v: usize) -> &[u8] {
        &self.cells[self.start(v)..][..self.width]
    }

    /// Closing, a dilation followed by an erosion: fills gaps narrower than about twice the radius.
    pub(crate) fn close(&mut self, radius: u32) {
        self.fill_frame(0);
        // The frame keeps the pixels that the dilation adds outside, so that the erosion does not eat the object's edge.
        (0..radius).for_each(|_| self.step(|a, b| a | b));
        (0..radius).for_each(|_| self.step(|a, b| a & b));
    }

    /// Opening, an erosion followed by a dilation: removes parts narrower than about twice the radius. The erosion counts
    /// pixels outside of the plane as set, so that an object does not shrink where the plane's edge cuts it.
    pub(crate) fn open(&mut self, radius: u32) {
        for _ in 0..radius {
            self.fill_frame(1);
            self.step(|a, b| a & b);
        }
        (0..radius).for_each(|_| self.dilate());
    }

    /// Dilation by one pixel. Pixels outside of the plane count as not set.
    pub(crate) fn dilate(&mut self) {
        self.fill_frame(0);
        self.step(|a, b| a | b);
    }

    /// Cells in a row, frame included.
    fn stride(&self) -> usize {
        self.width + 2 * self.frame
    }

    /// Index of the first cell of row `v` that is not in the frame.
    fn start(&self, v: usize) -> usize {
        (v + self.frame) * self.stride() + self.frame
    }

    /// Joins each cell with its four neighbours. The outermost ring, whose neighbourhoods are incomplete, does not change.
    fn step(&mut self, join: impl Fn(u8, u8) -> u8) {
        let (stride, inner) = (self.stride(), self.stride() - 2);
        let rows = self.cells.len() / stride;
        self.scratch.copy_from_slice(&self.cells);
        for v in 1..rows - 1 {
            let row = |start: usize| &self.cells[start..start + inner];
            let (up, down) = (row((v - 1) * stride + 1), row((v + 1) * stride + 1));
            let (left, middle, right) = (row(v * stride), row(v * stride + 1), row(v * stride + 2));
            let out = &mut self.scratch[v * stride + 1..][..inner];
            for u in 0..inner {
                out[u] = join(join(join(up[u], down[u]), join(left[u], right[u])), middle[u]);
            }
        }
        std::mem::swap(&mut self.cells, &mut self.scratch);
    }

    /// Sets every cell of the frame to `value`.
    fn fill_frame(&mut self, value: u8) {
        let (stride, frame, height) = (self.stride(), self.frame, self.height);
        for (v, row) in self.cells.chunks_exact_mut(stride).enumerate() {
            if v < frame || v >= frame + height {
                row.fill(value);
            } else {
                row[..frame].fill(value);
                row[stride - frame..].fill(value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(rows: &[&str]) -> Plane {
        let data = rows.concat().into_bytes();
        let mask = LabelMask::from_data(rows[0].len() as u32, rows.len() as u32, data).unwrap();
        let mut plane = Plane::default();
        plane.load(&mask, 4, |b| b == b'#');
        plane
    }

    fn rows(plane: &Plane) -> Vec<String> {
        let text = |v| plane.row(v).iter().map(|&c| if c == 1 { '#' } else { '.' }).collect();
        (0..plane.height).map(text).collect()
    }

    #[test]
    fn closing_fills_a_crack_and_opening_drops_a_hair() {
        let mut crack = plane(&[".......", ".##.##.", ".##.##.", ".##.##.", "......."]);
        crack.close(1);
        assert_eq!(rows(&crack)[2], ".#####.");
        let mut hair = plane(&["..#....", "..#....", ".###...", ".###...", ".###..."]);
        hair.open(1);
        assert_eq!(rows(&hair), [".......", "..#....", ".###...", ".###...", ".###..."]);
    }

    #[test]
    fn an_object_that_the_planes_edge_cuts_does_not_shrink_there() {
        let mut bar = plane(&["###....", "###....", "###....", ".......", "......."]);
        bar.open(1);
        // Only the free corner goes: a cross does not fit into it.
        assert_eq!(rows(&bar)[..3], ["###....", "###....", "##....."]);
        let opened = rows(&bar);
        bar.close(3);
        assert_eq!(rows(&bar), opened);
    }
}
