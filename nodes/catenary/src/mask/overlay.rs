//! Image with the outline of the mask, the object's pixels and the keypoints over it.

use catenary_core::image::label;
use catenary_core::{Keypoints, LabelMask, RgbImage};

/// Colours that no object of a laboratory should have, so that they stand out: of object, target, keypoints, and first keypoint.
const OBJECT: [u8; 3] = [255, 0, 220];
const TARGET: [u8; 3] = [255, 230, 0];
const KEYPOINT: [u8; 3] = [255, 255, 255];
const FIRST: [u8; 3] = [0, 255, 255];
/// Share of the label's colour over a labelled pixel, and on the outline.
const TINT: f64 = 0.35;
/// Share of the light that is left outside the square of the mask.
const OUTSIDE: f64 = 0.35;
/// Radius of a keypoint, and of the black ring around it, in mask pixels.
const DISC_PX: f64 = 2.2;
const RING_PX: f64 = 3.2;

/// Draws the mask and the keypoints over an image. `square` is the part of the image that the mask shows: left edge, upper edge and
/// side in pixels.
pub fn draw(image: &RgbImage, square: [f64; 3], mask: &LabelMask, keypoints: &Keypoints) -> RgbImage {
    let mut out = image.clone();
    let [left, top, side] = square;
    let size = f64::from(mask.width);
    let width = image.width as usize;
    let at = |u: i64, v: i64| {
        let inside = u >= 0 && v >= 0 && u < i64::from(mask.width) && v < i64::from(mask.height);
        inside.then(|| mask.at(u as u32, v as u32))
    };
    let seen = keypoints.scores.iter().all(|&s| s > 0.0);
    for (i, pixel) in out.data.chunks_exact_mut(3).enumerate() {
        let p = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let m = [(p[0] - left) * size / side, (p[1] - top) * size / side];
        let [u, v] = m.map(|c| c.floor() as i64);
        let Some(here) = at(u, v) else {
            pixel.iter_mut().for_each(|c| *c = (f64::from(*c) * OUTSIDE) as u8);
            continue;
        };
        let colour = match here {
            label::DLO => Some(OBJECT),
            label::TARGET => Some(TARGET),
            _ => None,
        };
        if let Some(colour) = colour {
            let is_edge = [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(du, dv)| at(u + du, v + dv) != Some(here));
            let share = if is_edge { 0.9 } else { TINT };
            blend(pixel, colour, share);
        }
        if seen {
            for (k, point) in keypoints.dlo_px.iter().enumerate() {
                let distance = (m[0] - point[0]).hypot(m[1] - point[1]);
                if distance < RING_PX {
                    let inner = if k == 0 { FIRST } else { KEYPOINT };
                    blend(pixel, if distance < DISC_PX { inner } else { [0; 3] }, 1.0);
                }
            }
        }
    }
    out
}

fn blend(pixel: &mut [u8], colour: [u8; 3], share: f64) {
    for (c, to) in pixel.iter_mut().zip(colour) {
        *c = (f64::from(*c) * (1.0 - share) + f64::from(to) * share).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outside_is_dark_the_outline_coloured_and_keypoints_only_if_seen() {
        let image = RgbImage { width: 6, height: 4, data: vec![200; 72] };
        let mut mask = LabelMask::new(4, 4);
        mask.data.fill(label::DLO);
        let mut keypoints = Keypoints {
            dlo_px: [[2.0, 2.0]; 4],
            target_px: None,
            scores: [0.0; 4],
            target_score: 0.0,
            image_width_px: 4,
            image_height_px: 4,
        };
        let square = [1.0, 0.0, 4.0];
        let at = |picture: &RgbImage, u: usize, v: usize| -> [u8; 3] {
            std::array::from_fn(|c| picture.data[3 * (6 * v + u) + c])
        };
        let drawn = draw(&image, square, &mask, &keypoints);
        assert_eq!(at(&drawn, 0, 0), [70; 3]);
        let outline = at(&drawn, 1, 0);
        assert!(outline.iter().zip([250, 20, 218]).all(|(c, e)| c.abs_diff(e) <= 1), "{outline:?}");
        assert_eq!(at(&drawn, 2, 1), [219, 130, 207]);
        keypoints.scores = [1.0; 4];
        assert_eq!(at(&draw(&image, square, &mask, &keypoints), 2, 1), KEYPOINT);
    }
}
