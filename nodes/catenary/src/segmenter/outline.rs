//! Outlines of a label's regions as polygons.

use catenary_core::LabelMask;
use catenary_core::regions::Regions;

/// Outer outlines of all regions of a label with at least `min_area_px` pixels: corners (u, v) of pixels, in order. Holes are filled.
pub fn outlines(mask: &LabelMask, label: u8, min_area_px: usize) -> Vec<Vec<[u32; 2]>> {
    let mut regions = Regions::default();
    regions.find(mask, label);
    let mut outlines = Vec::new();
    let mut inside = vec![false; mask.data.len()];
    for region in regions.found() {
        if region.area_px < min_area_px {
            continue;
        }
        let pixels = regions.pixels(region);
        pixels.iter().for_each(|&p| inside[p as usize] = true);
        // The first pixel of the first row has nothing of the region above it.
        let first = pixels.iter().min().map_or([0, 0], |&p| [p % mask.width, p / mask.width]);
        let is_inside = |[u, v]: [i64; 2]| {
            let size = [mask.width, mask.height].map(i64::from);
            (0..size[0]).contains(&u) && (0..size[1]).contains(&v) && inside[(v * size[0] + u) as usize]
        };
        outlines.push(follow(first.map(i64::from), is_inside));
        pixels.iter().for_each(|&p| inside[p as usize] = false);
    }
    outlines
}

/// Walks along the edges of the pixels from the upper left corner of `first`, with the region on the right, and returns the corners at
/// which it turns.
fn follow(first: [i64; 2], is_inside: impl Fn([i64; 2]) -> bool) -> Vec<[u32; 2]> {
    const STEPS: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    // Pixels ahead on the left and on the right of a corner, by direction.
    const LEFT: [[i64; 2]; 4] = [[0, -1], [0, 0], [-1, 0], [-1, -1]];
    const RIGHT: [[i64; 2]; 4] = [[0, 0], [-1, 0], [-1, -1], [0, -1]];
    let add = |a: [i64; 2], b: [i64; 2]| [a[0] + b[0], a[1] + b[1]];
    let (mut at, mut direction) = (first, 0);
    let mut corners = vec![first.map(|c| c as u32)];
    loop {
        at = add(at, STEPS[direction]);
        if at == first {
            return corners;
        }
        // Pixels that touch at a corner are one region, so that the left one comes first.
        let turn = if is_inside(add(at, LEFT[direction])) {
            3
        } else if is_inside(add(at, RIGHT[direction])) {
            0
        } else {
            1
        };
        if turn != 0 {
            corners.push(at.map(|c| c as u32));
            direction = (direction + turn) % 4;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::image::label;

    fn mask(rows: &[&str]) -> LabelMask {
        let mut mask = LabelMask::new(rows[0].len() as u32, rows.len() as u32);
        let labels = rows.concat().bytes().map(|b| if b == b'#' { label::DLO } else { label::BACKGROUND }).collect();
        mask.data = labels;
        mask
    }

    /// Area of a polygon by the shoelace formula.
    fn area(polygon: &[[u32; 2]]) -> f64 {
        let corner = |i: usize| polygon[i % polygon.len()].map(f64::from);
        let twice: f64 =
            (0..polygon.len()).map(|i| corner(i)[0] * corner(i + 1)[1] - corner(i + 1)[0] * corner(i)[1]).sum();
        0.5 * twice.abs()
    }

    #[test]
    fn the_area_of_an_outline_is_that_of_its_pixels() {
        let found = outlines(&mask(&["........", ".####...", ".#..##..", ".####.#.", "........"]), label::DLO, 1);
        // The hole of two pixels is filled, and the pixel at the corner belongs to the region.
        assert_eq!(found.len(), 1);
        assert_eq!(area(&found[0]), 12.0 + 2.0);
    }

    #[test]
    fn a_rectangle_has_four_corners_and_small_regions_are_left_out() {
        let found = outlines(&mask(&["###..#", "###...", "......"]), label::DLO, 2);
        assert_eq!(found, [vec![[0, 0], [3, 0], [3, 2], [0, 2]]]);
        assert_eq!(outlines(&mask(&["....", "...."]), label::DLO, 1), Vec::<Vec<[u32; 2]>>::new());
    }
}
