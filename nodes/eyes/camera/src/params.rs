//! Parameters of the colour segmentation.

use catenary_core::camera::MASK_SIZE_PX;

use crate::Error;
use crate::selection::SelectionRules;

/// Colours of one label: a sector of hue, a least saturation and a least chroma.
///
/// V is the largest of R, G and B, and C the largest minus the smallest. Saturation is C / V; chroma is C. Hue is the
/// angle of (2R − G − B, √3 (G − B)): 0 for red, 120° for green, 240° for blue.
///
/// Shading and a neutral shadow multiply R, G and B by one factor, which a power-law gamma turns into another factor.
/// Hue and saturation are ratios and do not change. CIELAB chroma is not used: it falls with the light, and a threshold
/// low enough for the shadow accepts grey noise in bright areas. The sensor's noise does not scale with the light.
/// `min_chroma` is a threshold on C. It excludes dark grey pixels, whose hue and saturation are noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourRange {
    /// Hue in degrees. The sector runs upwards from the first to the second angle, through 360 if the second is smaller.
    /// It is less than 180 wide.
    pub hue_deg: [f64; 2],
    /// Least saturation, 0 to 1. Larger excludes pale edges and reflections; smaller accepts washed-out parts.
    pub min_saturation: f64,
    /// Least chroma, 0 to 255. Larger excludes noise in dark areas; smaller accepts deep shadow.
    pub min_chroma: u8,
}

/// Square of the image that becomes the mask.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Crop {
    /// Largest square in the middle of the image, as in `catenary_core::camera`.
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
    /// Colours of the object. Default: blue. The least saturation is low because the lens mixes the edge of a bar with
    /// its bright background.
    pub dlo: ColourRange,
    /// Colours of the target. Default: green, as the paper's. The hue sector must not overlap the object's.
    pub target: ColourRange,
    /// Part of the image that becomes the mask.
    pub crop: Crop,
    /// Side of the mask in pixels.
    pub mask_size_px: u32,
    /// Radius of the closing, which fills small gaps. 0: no closing.
    pub close_radius_px: u32,
    /// Radius of the opening, which removes parts narrower than about twice the radius. 0: no opening.
    pub open_radius_px: u32,
    /// Least area of the object and of the target. Smaller regions are dropped as noise.
    pub min_area_px: usize,
    /// Largest distance at which two pieces of the object are both kept, whatever lies between. 0: only the largest piece is
    /// kept. The default is the keypoint tracker's `max_gap_px`: the tracker joins pieces up to there.
    pub max_occlusion_px: u32,
    /// Least area of a piece that is kept beside the largest one.
    pub min_piece_area_px: usize,
}

impl Default for ColourParams {
    fn default() -> Self {
        Self {
            dlo: ColourRange { hue_deg: [190.0, 250.0], min_saturation: 0.25, min_chroma: 24 },
            target: ColourRange { hue_deg: [100.0, 165.0], min_saturation: 0.4, min_chroma: 24 },
            crop: Crop::CentredSquare,
            mask_size_px: MASK_SIZE_PX,
            close_radius_px: 1,
            open_radius_px: 1,
            min_area_px: 20,
            max_occlusion_px: 40,
            min_piece_area_px: 6,
        }
    }
}

impl ColourParams {
    /// Rules of the choice of regions.
    pub(crate) fn selection(&self) -> SelectionRules {
        let Self { min_area_px, max_occlusion_px, min_piece_area_px, .. } = *self;
        SelectionRules { min_area_px, max_occlusion_px, min_piece_area_px }
    }

    /// Checks all ranges.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the field that is out of range.
    pub fn check(&self) -> Result<(), Error> {
        self.dlo.check(["dlo.hue_deg", "dlo.min_saturation"])?;
        self.target.check(["target.hue_deg", "target.min_saturation"])?;
        if self.dlo.meets(&self.target) {
            let got = format!("{:?}, and the object has {:?}", self.target.hue_deg, self.dlo.hue_deg);
            let expected = "a hue sector that does not overlap the object's";
            return Err(Error::Parameter { field: "target.hue_deg", expected, got });
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

    /// Width of the hue sector in degrees, also across 0.
    fn width_deg(&self) -> f64 {
        (self.hue_deg[1] - self.hue_deg[0]).rem_euclid(360.0)
    }

    /// Sector of 60 degrees opposite to this one, with the same limits.
    #[must_use]
    pub fn opposite(&self) -> Self {
        let middle = self.hue_deg[0] + 0.5 * self.width_deg() + 180.0;
        Self { hue_deg: [middle - 30.0, middle + 30.0].map(|h| h.rem_euclid(360.0).round()), ..*self }
    }

    /// Returns true if the two hue sectors overlap. Two sectors overlap exactly if one holds the other's start.
    pub fn meets(&self, other: &Self) -> bool {
        let holds = |range: &Self, hue: f64| (hue - range.hue_deg[0]).rem_euclid(360.0) <= range.width_deg();
        holds(self, other.hue_deg[0]) || holds(other, self.hue_deg[0])
    }
}

impl Crop {
    /// Left edge, upper edge and side of the square in image pixels, for an image of `width` x `height`.
    ///
    /// # Errors
    /// [`Error::CropOutside`] if the square does not lie within the image.
    pub fn square(self, width: u32, height: u32) -> Result<[f64; 3], Error> {
        let (w, h) = (f64::from(width), f64::from(height));
        let [left_px, top_px, side_px] = match self {
            Crop::CentredSquare => {
                let side = w.min(h);
                [0.5 * (w - side), 0.5 * (h - side), side]
            }
            Crop::Square { left_px, top_px, side_px } => [left_px, top_px, side_px],
        };
        // Comparisons with NaN are false: a crop of NaN counts as outside.
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
    fn values_out_of_range_are_rejected_with_the_fields_name() {
        assert_eq!(ColourParams::default().check(), Ok(()));
        rejects(|p| p.dlo.hue_deg = [190.0, 20.0], "dlo.hue_deg");
        rejects(|p| p.dlo.hue_deg = [f64::NAN, 20.0], "dlo.hue_deg");
        rejects(|p| p.target.min_saturation = 0.0, "target.min_saturation");
    }

    #[test]
    fn overlapping_hue_sectors_and_sizes_out_of_range_are_rejected() {
        rejects(|p| p.target.hue_deg = [200.0, 220.0], "target.hue_deg");
        rejects(|p| p.dlo.hue_deg = [350.0, 110.0], "target.hue_deg");
        rejects(|p| p.mask_size_px = 0, "mask_size_px");
        rejects(|p| p.open_radius_px = 17, "open_radius_px");
    }

    #[test]
    fn the_opposite_sector_never_overlaps() {
        let blue = ColourParams::default().dlo;
        assert_eq!(blue.opposite().hue_deg, [10.0, 70.0]);
        for from in 0..360 {
            let range = ColourRange { hue_deg: [f64::from(from), f64::from((from + 118) % 360)], ..blue };
            assert!(!range.meets(&range.opposite()), "{range:?}");
        }
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
