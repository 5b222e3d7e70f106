//! Picture of several moments, with a row for each episode, cropped to the moving parts.

use anyhow::{Context, Result};
use catenary_core::LabelMask;
use catenary_core::RgbImage;
use catenary_core::camera::Pinhole;
use catenary_core::image::label;
use image::{ImageFormat, Rgb};
use std::io::Cursor;
use std::ops::Range;

/// Factor between drawn and shown size; the averaging smooths edges.
pub const OVERSAMPLING: u32 = 2;
/// Gap between two moments, pixels.
const GAP_PX: usize = 4;
/// Margin around the moving parts before the reduction, pixels.
const MARGIN_PX: usize = 48;

/// Camera with more pixels and the same view.
pub fn oversampled(camera: &Pinhole) -> Pinhole {
    Pinhole {
        image_width_px: OVERSAMPLING * camera.image_width_px,
        image_height_px: OVERSAMPLING * camera.image_height_px,
        focal_px: f64::from(OVERSAMPLING) * camera.focal_px,
        ..*camera
    }
}

/// Rows of moments.
#[derive(Default)]
pub struct Sheet {
    rows: Vec<Vec<RgbImage>>,
    /// Columns and rows of pixels that contain anything but background.
    seen: Option<[Range<usize>; 2]>,
}

impl Sheet {
    /// Starts the next row.
    pub fn begin_row(&mut self) {
        self.rows.push(Vec::new());
    }

    /// Adds a moment to the row, rendered by the camera of [`oversampled`].
    pub fn push(&mut self, picture: &RgbImage, labels: &LabelMask) {
        let width = labels.width as usize;
        for (i, _) in labels.data.iter().enumerate().filter(|(_, l)| **l != label::BACKGROUND) {
            let (u, v) = (i % width, i / width);
            let [columns, rows] = self.seen.get_or_insert([u..u + 1, v..v + 1]);
            *columns = columns.start.min(u)..columns.end.max(u + 1);
            *rows = rows.start.min(v)..rows.end.max(v + 1);
        }
        if let Some(row) = self.rows.last_mut() {
            row.push(picture.clone());
        }
    }

    /// Encodes the sheet as PNG.
    pub fn png(&self) -> Result<Vec<u8>> {
        let first = self.rows.iter().flatten().next().context("no moment to draw")?;
        let whole = [first.width as usize, first.height as usize];
        // Without any object pixel, the whole picture is shown.
        let seen = self.seen.clone().unwrap_or([0..whole[0], 0..whole[1]]);
        let [columns, rows]: [Range<usize>; 2] =
            std::array::from_fn(|i| seen[i].start.saturating_sub(MARGIN_PX)..(seen[i].end + MARGIN_PX).min(whole[i]));
        let over = OVERSAMPLING as usize;
        let [w, h] = [columns.len() / over, rows.len() / over];
        let across = self.rows.iter().map(Vec::len).max().unwrap_or_default();
        let size = |n: usize, side: usize| (n * (side + GAP_PX) - GAP_PX) as u32;
        let mut sheet = image::RgbImage::from_pixel(size(across, w), size(self.rows.len(), h), Rgb([255; 3]));
        for (r, row) in self.rows.iter().enumerate() {
            for (c, picture) in row.iter().enumerate() {
                for (u, v) in (0..h).flat_map(|v| (0..w).map(move |u| (u, v))) {
                    let pixel = mean(picture, [columns.start + over * u, rows.start + over * v]);
                    sheet.put_pixel((c * (w + GAP_PX) + u) as u32, (r * (h + GAP_PX) + v) as u32, Rgb(pixel));
                }
            }
        }
        let mut png = Cursor::new(Vec::new());
        sheet.write_to(&mut png, ImageFormat::Png)?;
        Ok(png.into_inner())
    }
}

/// Mean of the pixels that become one; (u, v) is the upper left of them.
fn mean(picture: &RgbImage, [u, v]: [usize; 2]) -> [u8; 3] {
    let n = OVERSAMPLING as usize;
    let sum = |channel: usize| -> usize {
        let at = |i: usize| 3 * ((v + i / n) * picture.width as usize + u + i % n) + channel;
        (0..n * n).map(|i| usize::from(picture.data[at(i)])).sum()
    };
    std::array::from_fn(|channel| (sum(channel) / (n * n)) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_stand_in_rows_and_are_cropped_to_the_object() {
        let mut sheet = Sheet::default();
        for grey in [10, 200] {
            sheet.begin_row();
            for column in [100, 140, 160] {
                let mut picture = RgbImage::new(400, 300);
                picture.data.fill(grey);
                let mut labels = LabelMask::new(400, 300);
                labels.data[150 * 400 + column] = label::DLO;
                sheet.push(&picture, &labels);
            }
        }
        let png = image::load_from_memory(&sheet.png().unwrap()).unwrap().to_rgb8();
        let side = |seen: usize| (seen + 2 * MARGIN_PX) / OVERSAMPLING as usize;
        let (w, h) = (side(160 - 100 + 1), side(1));
        assert_eq!(png.dimensions(), ((3 * (w + GAP_PX) - GAP_PX) as u32, (2 * (h + GAP_PX) - GAP_PX) as u32));
        assert_eq!((png.get_pixel(1, 1).0, png.get_pixel(1, h as u32 + 5).0), ([10; 3], [200; 3]));
        assert_eq!(png.get_pixel(w as u32 + 1, 1).0, [255; 3]);
    }
}
