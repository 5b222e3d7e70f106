//! Class of one pixel by its colour.

use catenary_core::image::label;

use crate::{ColourParams, ColourRange};

/// Number of classes: the labels of a mask.
pub(crate) const CLASSES: usize = 3;

/// Pixels that the vectorised test of a row takes at once.
const BLOCK: usize = 32;

/// Integer form of a [`ColourRange`]. All inequalities but the one on chroma are homogeneous in (R, G, B): they do not
/// depend on the brightness.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sector {
    /// Normal of the sector's first boundary: `from` · (R, G, B) ≥ 0 within the sector.
    from: [i32; 3],
    /// Normal of the sector's second boundary: `to` · (R, G, B) ≤ 0 within the sector.
    to: [i32; 3],
    /// Least saturation in 1/256.
    min_saturation: i32,
    /// Least chroma, 0 to 255.
    min_chroma: i32,
}

impl Sector {
    pub(crate) fn new(range: &ColourRange) -> Self {
        // (a, b) = (2R − G − B, √3 (G − B)) lies to the left of the direction of hue h if cos h · b − sin h · a ≥ 0.
        let boundary = |hue_deg: f64| {
            let (sin, cos) = hue_deg.to_radians().sin_cos();
            let b = 3f64.sqrt() * cos;
            // Fixed point with 12 fractional bits: rounding turns a boundary by less than 0.01 degree, and the sum of
            // three products with bytes stays below 2^23.
            [-2.0 * sin, sin + b, sin - b].map(|k| (4096.0 * k).round() as i32)
        };
        Self {
            from: boundary(range.hue_deg[0]),
            to: boundary(range.hue_deg[1]),
            min_saturation: (256.0 * range.min_saturation).round() as i32,
            min_chroma: i32::from(range.min_chroma),
        }
    }

    /// Returns true if the colour of a pixel lies in the range.
    pub(crate) fn holds_pixel(&self, rgb: [u8; 3]) -> bool {
        let rgb = rgb.map(i32::from);
        let value = rgb[0].max(rgb[1]).max(rgb[2]);
        self.holds(rgb, value, value - rgb[0].min(rgb[1]).min(rgb[2]))
    }

    fn holds(&self, rgb: [i32; 3], value: i32, chroma: i32) -> bool {
        let dot = |k: [i32; 3]| k[0] * rgb[0] + k[1] * rgb[1] + k[2] * rgb[2];
        chroma >= self.min_chroma
            && 256 * chroma >= self.min_saturation * value
            && dot(self.from) >= 0
            && dot(self.to) <= 0
    }
}

/// Classifier of single pixels.
#[derive(Debug, Clone)]
pub(crate) struct Classifier {
    dlo: Sector,
    target: Sector,
    /// Smaller of the two labels' least chromas. Most pixels of a scene lie below it and need no further test.
    min_chroma: i32,
}

impl Classifier {
    pub(crate) fn new(params: &ColourParams) -> Self {
        Self {
            dlo: Sector::new(&params.dlo),
            target: Sector::new(&params.target),
            min_chroma: i32::from(params.dlo.min_chroma.min(params.target.min_chroma)),
        }
    }

    /// Writes the class of each RGB triple of `row` to `classes`. Returns true if any of them is not background.
    ///
    /// Most of a scene is grey. One test recognises whole blocks of it; the test treats every byte alike, so
    /// that the compiler can use vector instructions on the interleaved channels.
    pub(crate) fn classify_row(&self, row: &[u8], classes: &mut [u8]) -> bool {
        let mut any = false;
        for (block, classes) in row.chunks(3 * BLOCK).zip(classes.chunks_mut(BLOCK)) {
            if self.may_be_coloured(block) {
                for (rgb, class) in block.as_chunks().0.iter().zip(classes) {
                    *class = self.class(*rgb);
                    any |= *class != label::BACKGROUND;
                }
            } else {
                classes.fill(label::BACKGROUND);
            }
        }
        any
    }

    /// Returns true if any three neighbouring bytes reach the least chroma. Every third triple is a pixel.
    fn may_be_coloured(&self, block: &[u8]) -> bool {
        let min_chroma = self.min_chroma as u8;
        // Triples that straddle two pixels can only raise a false alarm, after which each pixel is classified alone.
        let (a, b, c) = (block, &block[1..], &block[2..]);
        let mut any = false;
        for ((&a, &b), &c) in a.iter().zip(b).zip(c) {
            // The largest minus the smallest of three numbers is the largest of their differences.
            let chroma = a.abs_diff(b).max(b.abs_diff(c)).max(a.abs_diff(c));
            any |= chroma >= min_chroma;
        }
        any
    }

    fn class(&self, rgb: [u8; 3]) -> u8 {
        let rgb = rgb.map(i32::from);
        let value = rgb[0].max(rgb[1]).max(rgb[2]);
        let chroma = value - rgb[0].min(rgb[1]).min(rgb[2]);
        if chroma >= self.min_chroma {
            // The two hue sectors do not overlap (`ColourParams::check`): the order of the tests is of no consequence.
            if self.dlo.holds(rgb, value, chroma) {
                return label::DLO;
            }
            if self.target.holds(rgb, value, chroma) {
                return label::TARGET;
            }
        }
        label::BACKGROUND
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(rgb: [u8; 3]) -> u8 {
        Classifier::new(&ColourParams::default()).class(rgb)
    }

    #[test]
    fn labels_do_not_depend_on_the_light_down_to_the_noise_floor() {
        // The smaller chroma of the two, 110, falls under the least chroma of 24 at 22 % of the light.
        for (albedo, expected) in [([40.0, 90.0, 200.0], label::DLO), ([50.0, 160.0, 70.0], label::TARGET)] {
            for percent in 25..=115 {
                let rgb = albedo.map(|c: f64| (c * f64::from(percent) / 100.0).round() as u8);
                assert_eq!(class(rgb), expected, "{percent} % of {albedo:?}");
            }
        }
    }

    #[test]
    fn greys_have_no_label_however_dark_with_noise_below_the_floor() {
        for albedo in [[150.0, 150.0, 150.0], [225.0, 225.0, 220.0], [50.0, 50.0, 55.0]] {
            for percent in 0..=115 {
                // A spread of 14 with the albedo's own 5 stays below the least chroma of 24.
                for noise in [[-7.0, 0.0, 7.0], [7.0, -7.0, 0.0]] {
                    let rgb: [u8; 3] =
                        std::array::from_fn(|i| (albedo[i] * f64::from(percent) / 100.0 + noise[i]) as u8);
                    assert_eq!(class(rgb), label::BACKGROUND, "{rgb:?}");
                }
            }
        }
    }

    #[test]
    fn a_sector_ends_at_its_hues() {
        // Without blue, the angle of (2R − G − B, √3 (G − B)) is t = √3 G / (2R − G).
        let sector = Sector::new(&ColourRange { hue_deg: [350.0, 40.0], min_saturation: 0.4, min_chroma: 24 });
        let holds = |rgb| sector.holds(rgb, 255, 255);
        let red_green = |hue_deg: f64| {
            let t = hue_deg.to_radians().tan();
            [255, (255.0 * 2.0 * t / (3f64.sqrt() + t)).round() as i32, 0]
        };
        assert!(holds([255, 0, 0]) && holds(red_green(39.0)));
        assert!(!holds(red_green(41.0)));
        assert!(holds([255, 0, 40]) && !holds([255, 0, 70]));
        assert!(!holds([0, 255, 255]), "the opposite hue");
    }
}
