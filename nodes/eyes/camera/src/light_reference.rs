//! Light of the picture in which colours were clicked, against that of another picture of the same scene.

use catenary_core::{LabelMask, RgbView};

use crate::{Crop, Error, SegmentationReport, Segmenter};

/// Shares of the pixels below the levels of a reference.
const SHARES: [f64; LEVELS] = [0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98];
/// Levels of each channel.
const LEVELS: usize = 7;
/// Rows and columns of the crop that are looked at.
const LINES: usize = 120;
/// Levels that tell the light: below is noise, above the camera may have clipped the level.
const TELLING: std::ops::RangeInclusive<f32> = 6.0..=240.0;
/// Range of a gain. Beyond it, colours are lost.
const GAINS: [f32; 2] = [0.1, 8.0];
/// Gains that change no colour by more than noise does.
const NEGLIGIBLE: f32 = 0.03;

/// Levels of a picture, from which the exposure and the white balance of another picture of the same scene follow. Most of a
/// picture is background: things that move change these levels little.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightReference {
    /// Quantiles of red, green and blue, 0 to 255.
    levels: [[f32; LEVELS]; 3],
}

impl LightReference {
    /// Number of values of a reference.
    pub const LEN: usize = 3 * LEVELS;

    /// Reference of the part of an image that becomes the mask.
    ///
    /// # Errors
    /// [`Error::CropOutside`] if the crop does not fit the image.
    pub fn of(image: RgbView<'_>, crop: Crop) -> Result<Self, Error> {
        let [left, top, side] = crop.square(image.width(), image.height())?;
        let mut counts = [[0_u32; 256]; 3];
        let place = |start: f64, k: usize| (start + (k as f64 + 0.5) * side / LINES as f64) as usize;
        for k in 0..LINES {
            let row = image.row(place(top, k) as u32);
            for u in (0..LINES).map(|k| place(left, k)) {
                (0..3).for_each(|c| counts[c][usize::from(row[3 * u + c])] += 1);
            }
        }
        Ok(Self { levels: counts.map(|of| quantiles(&of)) })
    }

    /// Reference of its values: the quantiles of red, then those of green, then those of blue. None for another number of values, or
    /// for values that do not rise within a channel.
    #[must_use]
    pub fn from_values(values: &[f64]) -> Option<Self> {
        let levels: [[f32; LEVELS]; 3] = {
            let all: [f64; Self::LEN] = values.try_into().ok()?;
            std::array::from_fn(|c| std::array::from_fn(|k| all[c * LEVELS + k] as f32))
        };
        let is_rising = |channel: &[f32; LEVELS]| channel.windows(2).all(|p| p[0] <= p[1]);
        levels.iter().all(is_rising).then_some(Self { levels })
    }

    /// Values, in the order of [`Self::from_values`].
    #[must_use]
    pub fn values(&self) -> [f64; Self::LEN] {
        std::array::from_fn(|i| f64::from(self.levels[i / LEVELS][i % LEVELS]))
    }

    /// Factors of red, green and blue from the reference to another picture.
    #[must_use]
    pub fn gains_to(&self, now: &Self) -> [f32; 3] {
        std::array::from_fn(|c| gain(&self.levels[c], &now.levels[c]))
    }
}

/// Factor from the levels of a channel to those of another picture: the median over the levels that tell it.
fn gain(then: &[f32; LEVELS], now: &[f32; LEVELS]) -> f32 {
    let pairs = || then.iter().zip(now);
    let mut ratios: Vec<f32> =
        pairs().filter(|(a, b)| TELLING.contains(a) && TELLING.contains(b)).map(|(a, b)| b / a).collect();
    let gain = if ratios.is_empty() {
        // Levels that are clipped now and were not tell the least gain that clips them; levels that are lost in the dark, the largest
        // that loses them.
        let were = || pairs().filter(|(a, _)| TELLING.contains(a)).map(|(a, b)| (*b, b / a));
        let brighter = were().filter(|(b, _)| b > TELLING.end()).map(|(_, ratio)| ratio).fold(1.0, f32::max);
        let darker = were().filter(|(b, _)| b < TELLING.start()).map(|(_, ratio)| ratio).fold(1.0, f32::min);
        brighter * darker
    } else {
        ratios.sort_by(f32::total_cmp);
        ratios[ratios.len() / 2]
    };
    gain.clamp(GAINS[0], GAINS[1])
}

fn quantiles(counts: &[u32; 256]) -> [f32; LEVELS] {
    let all = f64::from(counts.iter().sum::<u32>());
    SHARES.map(|share| {
        let mut below = 0.0;
        let level = counts.iter().position(|&count| {
            below += f64::from(count);
            below >= share * all
        });
        level.unwrap_or(255) as f32
    })
}

/// Segmenter that sees each image in the light of a reference.
pub(crate) struct Relit<S> {
    segmenter: S,
    reference: LightReference,
    crop: Crop,
    pixels: Vec<u8>,
}

impl<S> Relit<S> {
    pub(crate) fn new(segmenter: S, reference: LightReference, crop: Crop) -> Self {
        Self { segmenter, reference, crop, pixels: Vec::new() }
    }
}

impl<S: Segmenter> Segmenter for Relit<S> {
    fn segment(&mut self, image: RgbView<'_>, out: &mut LabelMask) -> Result<SegmentationReport, Error> {
        let gains = self.reference.gains_to(&LightReference::of(image, self.crop)?);
        if gains.iter().all(|g| (g - 1.0).abs() < NEGLIGIBLE) {
            return self.segmenter.segment(image, out);
        }
        let tables =
            gains.map(|gain| -> [u8; 256] { std::array::from_fn(|level| (level as f32 / gain).round() as u8) });
        let (width, height) = (image.width(), image.height());
        self.pixels.resize(3 * width as usize * height as usize, 0);
        for (v, out) in self.pixels.chunks_exact_mut(3 * width as usize).enumerate() {
            let rows = out.as_chunks_mut::<3>().0.iter_mut().zip(image.row(v as u32).as_chunks::<3>().0);
            for (out, rgb) in rows {
                *out = std::array::from_fn(|c| tables[c][usize::from(rgb[c])]);
            }
        }
        let relit =
            RgbView::new(width, height, 3 * width as usize, &self.pixels).expect("a row has three bytes a pixel");
        self.segmenter.segment(relit, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::{ColourParams, ColourSegmenter};
    use catenary_core::RgbImage;
    use catenary_core::image::label;

    fn lit(image: &RgbImage, gains: [f64; 3]) -> RgbImage {
        let level = |(i, v): (usize, &u8)| (f64::from(*v) * gains[i % 3]).round().clamp(0.0, 255.0) as u8;
        RgbImage { data: image.data.iter().enumerate().map(level).collect(), ..*image }
    }

    #[test]
    fn gains_of_exposure_and_white_balance_are_found_also_where_most_levels_are_clipped() {
        let image = Scene::hanging().image(1);
        let of = |image: &RgbImage| LightReference::of(image.view(), Crop::CentredSquare).unwrap();
        let reference = of(&image);
        for gains in [[1.0, 1.0, 1.0], [0.25, 0.25, 0.25], [1.25, 1.0, 0.75], [1.8, 1.5, 1.5]] {
            let found = reference.gains_to(&of(&lit(&image, gains)));
            let close = found.iter().zip(gains).all(|(f, g)| (f64::from(*f) / g - 1.0).abs() < 0.05);
            assert!(close, "{gains:?}: {found:?}");
        }
        // A white picture: its levels tell no more than that the gain is at least this.
        let grey = RgbImage { data: vec![100; image.data.len()], ..image };
        assert_eq!(of(&grey).gains_to(&of(&lit(&grey, [4.0; 3]))), [2.55; 3]);
        // A picture in the dark: no more than the least gain.
        assert_eq!(of(&grey).gains_to(&of(&lit(&grey, [0.02; 3]))), [GAINS[0]; 3]);
    }

    #[test]
    fn a_reference_is_its_values_and_values_out_of_order_are_none() {
        let reference = LightReference::of(Scene::hanging().image(1).view(), Crop::CentredSquare).unwrap();
        let mut values = reference.values();
        assert_eq!(LightReference::from_values(&values), Some(reference));
        assert_eq!(LightReference::from_values(&values[1..]), None);
        values[0] = 255.0;
        assert_eq!(LightReference::from_values(&values), None);
    }

    #[test]
    fn thresholds_find_a_relit_object_with_a_reference_and_lose_it_without() {
        let image = Scene::hanging().image(1);
        let reference = LightReference::of(image.view(), Crop::CentredSquare).unwrap();
        let params = ColourParams::default();
        let area = |segmenter: &mut dyn Segmenter, gains: [f64; 3]| {
            let mut mask = LabelMask::new(1, 1);
            segmenter.segment(lit(&image, gains).view(), &mut mask).unwrap();
            mask.data.iter().filter(|l| **l == label::DLO).count()
        };
        let plain = || ColourSegmenter::new(params).unwrap();
        let whole = area(&mut plain(), [1.0; 3]);
        let lamp = [1.6, 0.9, 0.4];
        let (without, with) =
            (area(&mut plain(), lamp), area(&mut Relit::new(plain(), reference, Crop::CentredSquare), lamp));
        assert!(without < whole / 2, "{without} of {whole}");
        assert!(with.abs_diff(whole) < whole / 10, "{with} of {whole}");
    }
}
