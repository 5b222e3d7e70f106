//! Connected regions of one label in a mask.

use crate::image::LabelMask;

/// Connected region of pixels that have one label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Number of pixels.
    pub area_px: usize,
    /// Mean of the pixel centres (u, v) in pixels; the centre of the first pixel is at (0.5, 0.5).
    pub centroid_px: [f64; 2],
    /// First and last column, both within the region.
    pub columns: [usize; 2],
    /// First and last row, both within the region.
    pub rows: [usize; 2],
    /// Index of its first pixel in the list of all pixels.
    first: usize,
}

/// Search for connected regions, with 8 neighbours for each pixel.
///
/// The buffers are reused: a later call on a mask of the same size allocates only if it finds more regions or pixels
/// than every call before.
#[derive(Debug, Clone, Default)]
pub struct Regions {
    /// Regions in the order of their first pixels.
    found: Vec<Region>,
    /// Pixels of all regions, region after region, as v · width + u.
    pixels: Vec<u32>,
    /// For each pixel the index of its region plus 1, or 0.
    ids: Vec<u32>,
}

impl Regions {
    /// Finds the regions of `label` and returns them in raster order of their first pixels.
    pub fn find(&mut self, mask: &LabelMask, label: u8) -> &[Region] {
        let (width, height) = (mask.width as usize, mask.height as usize);
        self.found.clear();
        self.pixels.clear();
        self.ids.clear();
        self.ids.resize(width * height, 0);
        for (v, row) in mask.data.chunks_exact(width.max(1)).enumerate().take(height) {
            // Most rows of a mask are background: one pass over the bytes is cheaper than a test for each pixel.
            if !row.contains(&label) {
                continue;
            }
            for u in 0..width {
                if row[u] == label && self.ids[v * width + u] == 0 {
                    self.flood(mask, label, [u, v]);
                }
            }
        }
        &self.found
    }

    /// Regions found by the last call of [`Self::find`].
    pub fn found(&self) -> &[Region] {
        &self.found
    }

    /// Largest region and its index. Among equals it is the first.
    pub fn largest(&self) -> Option<(usize, &Region)> {
        // `max_by_key` returns the last of equals, so the order is reversed.
        self.found.iter().enumerate().rev().max_by_key(|(_, r)| r.area_px)
    }

    /// Pixels of `region`, as v · width + u.
    pub fn pixels(&self, region: &Region) -> &[u32] {
        &self.pixels[region.first..region.first + region.area_px]
    }

    /// Index of the region that contains pixel v · width + u.
    pub fn at(&self, pixel: usize) -> Option<usize> {
        (self.ids[pixel] as usize).checked_sub(1)
    }

    /// Collects the region of the pixel `start` by breadth-first search. The list of its pixels serves as the queue.
    fn flood(&mut self, mask: &LabelMask, label: u8, start: [usize; 2]) {
        let (width, height) = (mask.width as usize, mask.height as usize);
        let (first, id) = (self.pixels.len(), self.found.len() as u32 + 1);
        let mut region = Region {
            area_px: 0,
            centroid_px: [0.0; 2],
            columns: [start[0], start[0]],
            rows: [start[1], start[1]],
            first,
        };
        self.ids[start[1] * width + start[0]] = id;
        self.pixels.push((start[1] * width + start[0]) as u32);
        let mut next = first;
        let mut sum = [0usize; 2];
        while let Some(&pixel) = self.pixels.get(next) {
            next += 1;
            let (u, v) = (pixel as usize % width, pixel as usize / width);
            sum = [sum[0] + u, sum[1] + v];
            region.columns = [region.columns[0].min(u), region.columns[1].max(u)];
            region.rows = [region.rows[0].min(v), region.rows[1].max(v)];
            for y in v.saturating_sub(1)..(v + 2).min(height) {
                for x in u.saturating_sub(1)..(u + 2).min(width) {
                    let near = y * width + x;
                    if mask.data[near] == label && self.ids[near] == 0 {
                        self.ids[near] = id;
                        self.pixels.push(near as u32);
                    }
                }
            }
        }
        region.area_px = next - first;
        region.centroid_px = sum.map(|s| s as f64 / region.area_px as f64 + 0.5);
        self.found.push(region);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_meet_at_corners_and_are_measured() {
        let rows = ["11...", ".1...", "..1.2", "....1"];
        let data = rows.concat().bytes().map(|b| if b == b'.' { 0 } else { b - b'0' }).collect();
        let mask = LabelMask::from_data(5, 4, data).unwrap();
        let mut regions = Regions::default();
        regions.find(&mask, 1);
        assert_eq!(regions.found().len(), 2);
        let (index, largest) = regions.largest().unwrap();
        assert_eq!((index, largest.area_px, largest.columns, largest.rows), (0, 4, [0, 2], [0, 2]));
        assert_eq!(largest.centroid_px, [1.5, 1.25]);
        assert_eq!(regions.pixels(largest).len(), 4);
        assert_eq!(regions.at(3 * 5 + 4), Some(1));
        assert_eq!(regions.find(&mask, 7).len(), 0);
        assert_eq!(regions.at(0), None);
    }
}
