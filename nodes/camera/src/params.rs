//! Parameters of the colour segmentation.

use catenary_core::camera::MASK_SIZE_PX;

use crate::Error;

/// The colours of one label: a sector of hue, a least saturation and a least chroma.
///
/// With V the largest and C the largest minus the smallest of R, G, B: saturation is C / V, chroma is C. Hue is the
/// angle of (2R − G − B, √3 (G − B)), 0 for red, 120° for green, 240° for blue. Hue and saturation are ratios: shading
/// and a neutral shadow multiply R, G and B by one factor, which a power-law gamma turns into another factor, so both
/// stand them. CIELAB chroma does not: it shrinks with the light, and so a threshold on it that is low enough for the
/// shadow lets grey noise in where it is bright. What does not scale with the light is the sensor's noise; the least
/// chroma keeps dark grey pixels, whose hue and saturation are noise, out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourRange {
    /// Hue in degrees: the sector runs from the first to the second, upwards through 360 where the second is smaller.
    /// Less than 180 wide.
    pub hue_deg: [f64; 2],
    /// Least saturation, 0 to 1. Larger keeps pale edges and reflections out; smaller keeps washed-out parts in.
    pub min_saturation: f64,
    /// Least chroma, 0 to 255. Larger keeps noise in dark areas out; smaller keeps deep shadow in.
    pub min_chroma: u8,
}

/// The square of the image that becomes the mask.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Crop {
    /// The largest square in the middle of the image: that of `catenary_core::camera`.
    #[default]
    CentredSquare,
    /// A square of image pixels.
    Square {
        /// Left edge in image pixels.
        left_px: f64,
        /// Upper edge in image pixels.
        top_px: f64,
        /// Side in image pixels.
        side_px: f64,
    },
}

/// Parameters of [`crate::ColourSegmenter`]. Lengths and areas are in mask pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourParams {
    /// Colours of the object. Default: blue, pale enough to keep the dark edge of a bar before a bright background,
    /// which the lens mixes with it.
    pub dlo: ColourRange,
    /// Colours of the target. Default: red to orange, more saturated than skin or wood. Its sector must not meet the
    /// object's.
    pub target: ColourRange,
    /// What is darker than this (largest of R, G, B) and has neither colour may be an occluder, such as the gripper.
    pub occluder_max_value: u8,
    /// What becomes the mask.
    pub crop: Crop,
    /// Side of the mask in pixels.
    pub mask_size_px: u32,
    /// Radius of the closing, which fills small gaps. 0: none.
    pub close_radius_px: u32,
    /// Radius of the opening, which takes away what is thinner than about twice the radius. 0: none.
    pub open_radius_px: u32,
    /// The least area of the object and of the target; less is dropped as noise.
    pub min_area_px: usize,
    /// Pieces of the object that are this near to one another, across an occluder or the target, are kept together. 0:
    /// only the largest piece is kept.
    pub max_occlusion_px: u32,
    /// The least area of such a piece.
    pub min_piece_area_px: usize,
}

impl Default for ColourParams {
    fn default() -> Self {
        Self {
            dlo: ColourRange { hue_deg: [190.0, 250.0], min_saturation: 0.25, min_chroma: 24 },
            target: ColourRange { hue_deg: [345.0, 35.0], min_saturation: 0.45, min_chroma: 24 },
            occluder_max_value: 70,
            crop: Crop::CentredSquare,
            mask_size_px: MASK_SIZE_PX,
            close_radius_px: 1,
            open_radius_px: 1,
            min_area_px: 20,
            max_occlusion_px: 28,
            min_piece_area_px: 6,
        }
    }
}

impl ColourParams {
    /// Rejects values out of range; names the field.
    pub fn check(&self) -> Result<(), Error> {
        self.dlo.check(["dlo.hue_deg", "dlo.min_saturation"])?;
        self.target.check(["target.hue_deg", "target.min_saturation"])?;
        if self.dlo.meets(&self.target) {
            let got = format!("{:?}, and the object has {:?}", self.target.hue_deg, self.dlo.hue_deg);
            return Err(Error::Parameter { field: "target.hue_deg", expected: "hues that the object has not", got });
        }
        let in_range = |field, expected, value: u32, range: std::ops::RangeInclusive<u32>| {
            if range.contains(&value) {
                Ok(())
            } else {
                Err(Error::Parameter { field, expected, got: value.to_string() })
            }
        };
        in_range("mask_size_px", "8 to 4096", self.mask_size_px, 8..=4096)?;
        in_range("close_radius_px", "0 to 16", self.close_radius_px, 0..=16)?;
        in_range("open_radius_px", "0 to 16", self.open_radius_px, 0..=16)?;
        in_range("max_occlusion_px", "0 to 255", self.max_occlusion_px, 0..=255)
    }
}

impl ColourRange {
    fn check(&self, [hue, saturation]: [&'static str; 2]) -> Result<(), Error> {
        if !(self.hue_deg.iter().all(|h| (0.0..=360.0).contains(h)) && self.width_deg() < 180.0) {
            let expected = "two angles from 0 to 360, the sector between them less than 180 wide";
            return Err(Error::Parameter { field: hue, expected, got: format!("{:?}", self.hue_deg) });
        }
        if !(self.min_saturation > 0.0 && self.min_saturation < 1.0) {
            let got = self.min_saturation.to_string();
            return Err(Error::Parameter { field: saturation, expected: "more than 0 and less than 1", got });
        }
        Ok(())
    }

    fn width_deg(&self) -> f64 {
        (self.hue_deg[1] - self.hue_deg[0]).rem_euclid(360.0)
    }

    fn meets(&self, other: &Self) -> bool {
        let holds = |range: &Self, hue: f64| (hue - range.hue_deg[0]).rem_euclid(360.0) <= range.width_deg();
        holds(self, other.hue_deg[0]) || holds(other, self.hue_deg[0])
    }
}

impl Crop {
    /// Left edge, upper edge and side in image pixels, of an image of `width` x `height`.
    pub(crate) fn square(self, width: u32, height: u32) -> Result<[f64; 3], Error> {
        let (w, h) = (f64::from(width), f64::from(height));
        let [left_px, top_px, side_px] = match self {
            Crop::CentredSquare => {
                let side = w.min(h);
                [0.5 * (w - side), 0.5 * (h - side), side]
            }
            Crop::Square { left_px, top_px, side_px } => [left_px, top_px, side_px],
        };
        let inside =
            left_px >= 0.0 && top_px >= 0.0 && side_px > 0.0 && left_px + side_px <= w && top_px + side_px <= h;
        if inside {
            Ok([left_px, top_px, side_px])
        } else {
            Err(Error::CropOutside { width, height, left_px, top_px, side_px })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rejects(change: impl FnOnce(&mut ColourParams), field: &str) {
        let mut params = ColourParams::default();
        change(&mut params);
        let message = params.check().unwrap_err().to_string();
        assert!(message.starts_with(&format!("{field}: expected")), "{message}");
    }

    #[test]
    fn bad_values_are_rejected_by_name() {
        assert_eq!(ColourParams::default().check(), Ok(()));
        rejects(|p| p.dlo.hue_deg = [190.0, 20.0], "dlo.hue_deg");
        rejects(|p| p.dlo.hue_deg = [f64::NAN, 20.0], "dlo.hue_deg");
        rejects(|p| p.target.min_saturation = 0.0, "target.min_saturation");
    }

    #[test]
    fn sectors_that_meet_are_rejected_also_through_zero() {
        rejects(|p| p.target.hue_deg = [200.0, 220.0], "target.hue_deg");
        rejects(|p| p.dlo.hue_deg = [350.0, 10.0], "target.hue_deg");
        rejects(|p| p.mask_size_px = 0, "mask_size_px");
        rejects(|p| p.open_radius_px = 17, "open_radius_px");
    }

    #[test]
    fn the_crop_must_lie_in_the_image() {
        assert_eq!(Crop::CentredSquare.square(640, 480), Ok([80.0, 0.0, 480.0]));
        let crop = Crop::Square { left_px: 200.0, top_px: 0.0, side_px: 480.0 };
        assert!(crop.square(640, 480).is_err());
        let nan = Crop::Square { left_px: f64::NAN, top_px: 0.0, side_px: 480.0 };
        assert!(nan.square(640, 480).is_err());
    }
}
