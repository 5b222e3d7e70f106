//! Downsampling of classified pixels: each mask pixel takes the class that covers most of its area.
//!
//! Pixels are classified before they are averaged. Averaging colours first would give edges a mixed colour and move the
//! edges of a bar that is four pixels wide.

use catenary_core::image::label;
use catenary_core::{LabelMask, RgbView};

use super::classify::{CLASSES, Classifier};
use crate::{Crop, Error};

/// Units per image pixel in which the edges of mask pixels are counted.
const UNITS: usize = 16;
/// Largest number of image pixels along a side of a mask pixel. The four areas of a mask pixel share one u64 with 16 bits
/// each, into which (15 · 16)² units fit.
const MAX_SCALE: f64 = 15.0;

/// Downsampling by a vote of areas. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Vote {
    /// Edges of the mask's columns in the image, in units; one more than columns.
    columns: Vec<usize>,
    /// Edges of the mask's rows in the image, in units; one more than rows.
    rows: Vec<usize>,
    classes: Vec<u8>,
    /// Prefix sums of the classes of one image row.
    sums: Vec<u64>,
    /// Areas of the classes in each pixel of the current mask row.
    areas: Vec<u64>,
}

impl Vote {
    /// Writes the class of each mask pixel to `out`, which has the size of the mask.
    ///
    /// # Errors
    /// [`Error::CropOutside`] if the crop leaves the image; [`Error::Parameter`] if it exceeds 15 times the mask's side.
    pub(crate) fn vote(
        &mut self,
        classifier: &Classifier,
        image: RgbView<'_>,
        crop: Crop,
        out: &mut LabelMask,
    ) -> Result<(), Error> {
        let [left, top, side] = crop.square(image.width(), image.height())?;
        let size = out.width as usize;
        if side > MAX_SCALE * size as f64 {
            let got = format!("{side} px for a mask of {size} px");
            return Err(Error::Parameter { field: "crop.side_px", expected: "at most 15 times the mask's side", got });
        }
        edges(&mut self.columns, left, side, size);
        edges(&mut self.rows, top, side, size);
        let (first, last) = (self.columns[0] / UNITS, self.columns[size].div_ceil(UNITS));
        self.classes.resize(last - first, 0);
        self.areas.clear();
        self.areas.resize(size, 0);
        let mut row = 0;
        for v in self.rows[0] / UNITS..self.rows[size].div_ceil(UNITS) {
            // A row of background adds no area: `largest` gives the background what the others leave.
            let labelled = classifier.classify_row(&image.row(v as u32)[3 * first..3 * last], &mut self.classes);
            if labelled {
                self.sum_row();
            }
            while row < size && self.rows[row] < (v + 1) * UNITS {
                let height = self.rows[row + 1].min((v + 1) * UNITS) - self.rows[row].max(v * UNITS);
                if labelled {
                    self.add_row(first, height as u64);
                }
                if self.rows[row + 1] > (v + 1) * UNITS {
                    // The mask row continues in the next image row.
                    break;
                }
                let height = (self.rows[row + 1] - self.rows[row]) as u64;
                for (u, (areas, label)) in self.areas.iter_mut().zip(&mut out.data[row * size..]).enumerate() {
                    *label = largest(*areas, height * (self.columns[u + 1] - self.columns[u]) as u64);
                    *areas = 0;
                }
                row += 1;
            }
        }
        Ok(())
    }

    /// Fills `sums`: entry i counts the pixels of each class before pixel i.
    fn sum_row(&mut self) {
        self.sums.clear();
        self.sums.push(0);
        let mut sum = 0;
        self.sums.extend(self.classes.iter().map(|&class| {
            sum += lane(class);
            sum
        }));
    }

    /// Adds a strip of the image row, `height` units high, to the areas of the mask row.
    fn add_row(&mut self, first: usize, height: u64) {
        let upto = |edge: usize| {
            let (pixel, part) = (edge / UNITS - first, (edge % UNITS) as u64);
            let whole = UNITS as u64 * self.sums[pixel];
            if part == 0 { whole } else { whole + part * lane(self.classes[pixel]) }
        };
        let mut before = upto(self.columns[0]);
        for (area, &edge) in self.areas.iter_mut().zip(&self.columns[1..]) {
            let after = upto(edge);
            *area += height * (after - before);
            before = after;
        }
    }
}

/// One unit of area of `class` in its 16 bits. The background is not counted: its area is the rest.
fn lane(class: u8) -> u64 {
    if class == label::BACKGROUND { 0 } else { 1 << (16 * u32::from(class)) }
}

/// Class that covers most of the area `total`; the lowest of equals.
fn largest(areas: u64, total: u64) -> u8 {
    if areas == 0 {
        return label::BACKGROUND;
    }
    let area = |class: usize| (areas >> (16 * class)) & 0xffff;
    let background = total - (1..CLASSES).map(area).sum::<u64>();
    let (mut best, mut most) = (0, background);
    for class in 1..CLASSES {
        if area(class) > most {
            (best, most) = (class as u8, area(class));
        }
    }
    best
}

/// Edges of `size` equal mask pixels from `start` over `side` image pixels, rounded to units.
fn edges(edges: &mut Vec<usize>, start: f64, side: f64, size: usize) {
    edges.clear();
    edges.extend((0..=size).map(|i| ((start + side * i as f64 / size as f64) * UNITS as f64).round() as usize));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ColourParams;
    use catenary_core::RgbImage;

    const BLUE: [u8; 3] = [40, 90, 200];
    const GREEN: [u8; 3] = [50, 160, 70];
    const WHITE: [u8; 3] = [225, 225, 220];

    fn vote(image: &RgbImage, crop: Crop, size: u32) -> Result<LabelMask, Error> {
        let mut out = LabelMask::new(size, size);
        Vote::default().vote(&Classifier::new(&ColourParams::default()), image.view(), crop, &mut out)?;
        Ok(out)
    }

    fn image(width: u32, height: u32, colour: impl Fn(u32, u32) -> [u8; 3]) -> RgbImage {
        let mut image = RgbImage::new(width, height);
        image.data =
            (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).flat_map(|(u, v)| colour(u, v)).collect();
        image
    }

    #[test]
    fn a_mask_pixel_takes_the_class_of_the_largest_area_with_parts_of_pixels() {
        // Two mask pixels over three columns: the first holds 1 blue and 1/2 white, the second 1/2 white and 1 green.
        let three = image(3, 3, |u, _| [BLUE, WHITE, GREEN][u as usize]);
        assert_eq!(vote(&three, Crop::CentredSquare, 2).unwrap().data, [1, 2, 1, 2]);
        // 1/2 blue and 1 white; 1/2 white and 1 white.
        let narrow = Crop::Square { left_px: 0.5, top_px: 0.0, side_px: 3.0 };
        let four = image(4, 3, |u, _| if u == 0 { BLUE } else { WHITE });
        assert_eq!(vote(&four, narrow, 2).unwrap().data, [0, 0, 0, 0]);
    }

    #[test]
    fn a_mask_finer_than_the_image_repeats_it() {
        let two = image(2, 2, |u, v| if u == v { BLUE } else { WHITE });
        assert_eq!(vote(&two, Crop::CentredSquare, 4).unwrap().data, [1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 1]);
    }

    #[test]
    fn the_largest_scale_fits_its_bits_and_a_larger_one_is_refused() {
        let all_blue = image(15 * 8, 15 * 8, |_, _| BLUE);
        assert!(vote(&all_blue, Crop::CentredSquare, 8).unwrap().data.iter().all(|&l| l == 1));
        let message = vote(&all_blue, Crop::CentredSquare, 7).unwrap_err().to_string();
        assert!(message.contains("crop.side_px"), "{message}");
    }
}
