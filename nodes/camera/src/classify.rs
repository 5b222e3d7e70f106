//! Class of one pixel by its colour.

use catenary_core::image::label;

use crate::{ColourParams, ColourRange};

/// Class of dark pixels without colour: they may stand in front of the object. Never written to a mask.
pub(crate) const OCCLUDER: u8 = 3;
/// Number of classes: the labels, and [`OCCLUDER`].
pub(crate) const CLASSES: usize = 4;

/// Pixels that are tested at once.
const BLOCK: usize = 32;

/// A [`ColourRange`] as integer inequalities, each homogeneous in (R, G, B) but the noise floor.
#[derive(Debug, Clone, Copy)]
struct Sector {
    /// Within the sector, `from` · (R, G, B) ≥ 0 and `to` · (R, G, B) ≤ 0.
    from: [i32; 3],
    to: [i32; 3],
    /// Least saturation in 1/256.
    min_saturation: i32,
    min_chroma: i32,
}

impl Sector {
    fn new(range: &ColourRange) -> Self {
        // The direction h of hue and (a, b) = (2R − G − B, √3 (G − B)) turn left when cos h · b − sin h · a ≥ 0.
        let boundary = |hue_deg: f64| {
            let (sin, cos) = hue_deg.to_radians().sin_cos();
            let b = 3f64.sqrt() * cos;
            [-2.0 * sin, sin + b, sin - b].map(|k| (4096.0 * k).round() as i32)
        };
        Self {
            from: boundary(range.hue_deg[0]),
            to: boundary(range.hue_deg[1]),
            min_saturation: (256.0 * range.min_saturation).round() as i32,
            min_chroma: i32::from(range.min_chroma),
        }
    }

    fn holds(&self, rgb: [i32; 3], value: i32, chroma: i32) -> bool {
        let dot = |k: [i32; 3]| k[0] * rgb[0] + k[1] * rgb[1] + k[2] * rgb[2];
        chroma >= self.min_chroma
            && 256 * chroma >= self.min_saturation * value
            && dot(self.from) >= 0
            && dot(self.to) <= 0
    }
}

/// Sorts pixels into classes.
#[derive(Debug, Clone)]
pub(crate) struct Classifier {
    dlo: Sector,
    target: Sector,
    /// The smallest chroma that either label accepts: most pixels of a scene are greyer, and need no more tests.
    min_chroma: i32,
    occluder_max_value: i32,
}

impl Classifier {
    pub(crate) fn new(params: &ColourParams) -> Self {
        Self {
            dlo: Sector::new(&params.dlo),
            target: Sector::new(&params.target),
            min_chroma: i32::from(params.dlo.min_chroma.min(params.target.min_chroma)),
            occluder_max_value: i32::from(params.occluder_max_value),
        }
    }

    /// The class of each RGB triple of `row`; whether any is not background.
    ///
    /// Most of a scene is grey and light: whole blocks of it are told by a test that is the same for every byte, so that
    /// the compiler can use vector instructions on the interleaved channels.
    pub(crate) fn classify_row(&self, row: &[u8], classes: &mut [u8]) -> bool {
        let mut any = false;
        for (block, classes) in row.chunks(3 * BLOCK).zip(classes.chunks_mut(BLOCK)) {
            if self.may_be_coloured_or_dark(block) {
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

    /// Whether any three neighbouring bytes (every third of them is a pixel) pass the chroma floor or are dark.
    fn may_be_coloured_or_dark(&self, block: &[u8]) -> bool {
        let (min_chroma, dark) = (self.min_chroma as u8, self.occluder_max_value as u8);
        let (a, b, c) = (block, &block[1..], &block[2..]);
        let mut any = false;
        for ((&a, &b), &c) in a.iter().zip(b).zip(c) {
            let chroma = a.abs_diff(b).max(b.abs_diff(c)).max(a.abs_diff(c));
            any |= (chroma >= min_chroma) | (a.max(b).max(c) < dark);
        }
        any
    }

    fn class(&self, rgb: [u8; 3]) -> u8 {
        let rgb = rgb.map(i32::from);
        let value = rgb[0].max(rgb[1]).max(rgb[2]);
        let chroma = value - rgb[0].min(rgb[1]).min(rgb[2]);
        if chroma >= self.min_chroma {
            if self.dlo.holds(rgb, value, chroma) {
                return label::DLO;
            }
            if self.target.holds(rgb, value, chroma) {
                return label::TARGET;
            }
        }
        if value < self.occluder_max_value { OCCLUDER } else { label::BACKGROUND }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(rgb: [u8; 3]) -> u8 {
        Classifier::new(&ColourParams::default()).class(rgb)
    }

    #[test]
    fn labels_stand_any_light_down_to_the_noise_floor() {
        for (albedo, expected) in [([40.0, 90.0, 200.0], label::DLO), ([220.0, 60.0, 30.0], label::TARGET)] {
            for percent in 20..=115 {
                let rgb = albedo.map(|c: f64| (c * f64::from(percent) / 100.0).round() as u8);
                assert_eq!(class(rgb), expected, "{percent} % of {albedo:?}");
            }
        }
    }

    #[test]
    fn greys_have_no_label_however_dark_with_noise_below_the_floor() {
        for albedo in [[150.0, 150.0, 150.0], [225.0, 225.0, 220.0], [50.0, 50.0, 55.0]] {
            for percent in 0..=115 {
                for noise in [[-7.0, 0.0, 7.0], [7.0, -7.0, 0.0]] {
                    let rgb: [u8; 3] =
                        std::array::from_fn(|i| (albedo[i] * f64::from(percent) / 100.0 + noise[i]) as u8);
                    assert!([label::BACKGROUND, OCCLUDER].contains(&class(rgb)), "{rgb:?}");
                }
            }
        }
        assert_eq!(class([50, 50, 55]), OCCLUDER);
        assert_eq!(class([150, 150, 150]), label::BACKGROUND);
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
