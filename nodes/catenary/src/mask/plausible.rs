//! Doubts about what was found: keypoints that may be wrong, and a look that is that of a wall and not of a thin object.

use catenary_core::LabelMask;
use catenary_core::image::label;

/// Score above which keypoints are usually right.
const GOOD_SCORE: f32 = 0.5;
/// Share of the mask above which a thing is no thin object: a bar across the whole picture, a sixth as wide as long, has less.
const MOST_SHARE: f64 = 0.25;
/// Number of borders of the mask that a thin object may reach: it comes in by one and leaves by another.
const MOST_BORDERS: usize = 2;
/// Length in widths below which a thing is a blob: 4 for a square and 5 for a disc by the measure of [`Shape::length_in_widths`],
/// 13 for the bar of the paper.
const LEAST_LENGTH: f64 = 6.0;
/// Distance in mask pixels from the object within which a click counts as on it: the edge of a thin object is mixed.
const ON_IT_PX: i64 = 3;

/// True if all four keypoints are usually right.
pub fn is_sure(scores: &[f32; 4]) -> bool {
    scores.iter().all(|&score| score >= GOOD_SCORE)
}

/// Size and shape of a label in a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Share of the mask.
    share: f64,
    /// Number of the mask's borders that it reaches.
    borders: usize,
    area_px: usize,
    /// Number of sides of its pixels at which it ends.
    edge_px: usize,
    is_object: bool,
}

impl Shape {
    /// Shape of the object in a mask.
    pub fn of_object(mask: &LabelMask) -> Self {
        Self::of(mask, label::DLO)
    }

    /// Shape of the target in a mask.
    pub fn of_target(mask: &LabelMask) -> Self {
        Self::of(mask, label::TARGET)
    }

    fn of(mask: &LabelMask, wanted: u8) -> Self {
        let (width, height) = (i64::from(mask.width), i64::from(mask.height));
        let holds = |u: i64, v: i64| {
            (0..width).contains(&u) && (0..height).contains(&v) && mask.at(u as u32, v as u32) == wanted
        };
        let (mut area_px, mut edge_px, mut sides) = (0, 0, [false; 4]);
        for v in 0..height {
            for u in (0..width).filter(|u| holds(*u, v)) {
                area_px += 1;
                edge_px += [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().filter(|(du, dv)| !holds(u + du, v + dv)).count();
                let at = [u == 0, u == width - 1, v == 0, v == height - 1];
                sides.iter_mut().zip(at).for_each(|(side, at)| *side |= at);
            }
        }
        let borders = sides.iter().filter(|side| **side).count();
        let share = area_px as f64 / (width * height).max(1) as f64;
        Self { share, borders, area_px, edge_px, is_object: wanted == label::DLO }
    }

    /// True if the mask has any of it.
    pub fn is_there(self) -> bool {
        self.area_px > 0
    }

    /// Length over width of a strip with this area and edge.
    fn length_in_widths(self) -> f64 {
        let width_px = 2.0 * self.area_px as f64 / self.edge_px.max(1) as f64;
        self.area_px as f64 / (width_px * width_px)
    }

    /// Reasons for which this is no object or target, one phrase each.
    pub fn doubts(self) -> Vec<String> {
        let mut doubts = Vec::new();
        if self.area_px == 0 {
            return doubts;
        }
        if self.share > MOST_SHARE {
            doubts.push(format!("it covers {:.0} % of the mask", 100.0 * self.share));
        }
        if self.borders > MOST_BORDERS {
            doubts.push(format!("it reaches {} of the mask's 4 borders", self.borders));
        }
        let length = self.length_in_widths();
        if self.is_object && length < LEAST_LENGTH {
            doubts.push(format!("it is only {length:.1} times as long as wide"));
        }
        doubts
    }
}

/// True if a pixel of the image lies on a label of the mask, or beside it. `square` is the part of the image that the mask
/// shows: left edge, upper edge and side in pixels.
pub fn is_on(click: [u32; 2], mask: &LabelMask, square: [f64; 3], wanted: u8) -> bool {
    let [left, top, side] = square;
    let scale = f64::from(mask.width) / side;
    let at = |pixel: u32, from: f64| ((f64::from(pixel) + 0.5 - from) * scale).floor() as i64;
    let [u, v] = [at(click[0], left), at(click[1], top)];
    let holds = |u: i64, v: i64| {
        let inside = u >= 0 && v >= 0 && u < i64::from(mask.width) && v < i64::from(mask.height);
        inside && mask.at(u as u32, v as u32) == wanted
    };
    (-ON_IT_PX..=ON_IT_PX).any(|dv| (-ON_IT_PX..=ON_IT_PX).any(|du| holds(u + du, v + dv)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(holds: impl Fn(i64, i64) -> bool) -> LabelMask {
        let mut mask = LabelMask::new(256, 256);
        for (i, pixel) in mask.data.iter_mut().enumerate() {
            if holds(i as i64 % 256, i as i64 / 256) {
                *pixel = label::DLO;
            }
        }
        mask
    }

    fn doubts(holds: impl Fn(i64, i64) -> bool) -> String {
        Shape::of_object(&mask(holds)).doubts().join("; ")
    }

    #[test]
    fn bars_and_cables_are_objects_and_walls_and_blobs_are_not() {
        // A thin cable, a bar, one that hangs through the whole picture, an arc, and one in three pieces.
        assert_eq!(doubts(|u, v| (u - 100).abs() < 2 && (20..230).contains(&v)), "");
        assert_eq!(doubts(|u, v| (u - 100).abs() < 8 && (20..200).contains(&v)), "");
        assert_eq!(doubts(|u, _| (u - 100).abs() < 6), "");
        assert_eq!(doubts(|u, v| ((u - 128).pow(2) + (v - 128).pow(2) - 80 * 80).abs() < 800), "");
        assert_eq!(doubts(|u, v| (u - 100).abs() < 4 && (20..200).contains(&v) && v / 40 % 2 == 0), "");
        let wall = doubts(|u, v| v < 150 && !(100..120).contains(&u));
        assert!(wall.contains("covers 54 %") && wall.contains("3 of the mask's 4 borders"), "{wall}");
        assert!(doubts(|u, v| (u - 100).abs() < 20 && (v - 100).abs() < 20).contains("4.0 times as long"));
        assert!(doubts(|u, v| (u - 100).pow(2) + (v - 100).pow(2) < 900).contains("times as long as wide"));
        assert_eq!(doubts(|_, _| false), "");
    }

    #[test]
    fn a_click_lies_on_the_object_or_beside_it() {
        let mask = mask(|u, v| u == 100 && v == 50);
        // A square of 512 pixels from (64, 10): two pixels of the image are one of the mask.
        let on = |click| is_on(click, &mask, [64.0, 10.0, 512.0], label::DLO);
        assert!(on([265, 111]) && on([270, 115]) && !on([280, 111]) && !on([0, 0]));
    }
}
