//! Data set for the training of a YOLOv8-seg network, in the layout that `ultralytics` reads.

use super::outline::outlines;
use crate::exit::WrongInput;
use anyhow::{Context, Result};
use catenary_core::image::label;
use catenary_core::{LabelMask, RgbImage, seed};
use image::imageops;
use rand::{Rng, RngExt};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Side of the pictures in pixels, as in the paper.
const SIDE_PX: u32 = 256;
/// Changed copies of a frame, as in the paper's data set.
const COPIES: usize = 2;
/// Largest blur of a copy, pixels, and share of its pixels that become white or black.
const MOST_BLUR_PX: f32 = 1.5;
const MOST_SALT: f64 = 0.02;
/// Every so many frames one is for validation.
const VALIDATION: usize = 5;
/// Least area of a region that becomes an object.
const LEAST_AREA_PX: usize = 8;
/// Name and text of the data set's description.
const NAME: &str = "data.yaml";
const DESCRIPTION: &str = "# Data set for YOLOv8-seg, from `catenary label --yolo`.\ntrain: images/train\nval: images/val\nnames:\n  0: object\n  1: target\n";

/// Creates the folders and the description. A folder with a data set is refused: its polygons may be corrected ones.
pub fn prepare(folder: &Path) -> Result<()> {
    if folder.join(NAME).exists() {
        let name = folder.display();
        return Err(WrongInput::error(format!("--out {name}: expected a folder without {NAME}, got one with it")));
    }
    for part in ["train", "val"] {
        for kind in ["images", "labels"] {
            let path = folder.join(kind).join(part);
            std::fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
        }
    }
    write(folder.join(NAME), DESCRIPTION.as_bytes())
}

/// Writes a frame and, for training, changed copies of it, each with its polygons.
pub fn add(folder: &Path, number: usize, image: &RgbImage, mask: &LabelMask) -> Result<()> {
    let part = if number % VALIDATION == VALIDATION - 1 { "val" } else { "train" };
    let pixels =
        image::RgbImage::from_raw(image.width, image.height, image.data.clone()).context("a frame of pixels")?;
    let frame = imageops::resize(&pixels, SIDE_PX, SIDE_PX, imageops::FilterType::Triangle);
    let polygons = polygons(mask);
    let copies = if part == "train" { COPIES } else { 0 };
    for copy in 0..=copies {
        let changed = match copy {
            0 => frame.clone(),
            _ => changed(&frame, &mut seed::rng(number as u64, copy as u64)),
        };
        let name = format!("{number:03}_{copy}");
        let file = folder.join("images").join(part).join(format!("{name}.png"));
        changed.save(&file).with_context(|| file.display().to_string())?;
        write(folder.join("labels").join(part).join(format!("{name}.txt")), polygons.as_bytes())?;
    }
    Ok(())
}

/// A line for each region: number of the class, then corners as shares of the side.
fn polygons(mask: &LabelMask) -> String {
    let mut text = String::new();
    for (class, label) in [label::DLO, label::TARGET].into_iter().enumerate() {
        for outline in outlines(mask, label, LEAST_AREA_PX) {
            let share = |c: u32, size: u32| f64::from(c) / f64::from(size);
            let _infallible = write!(text, "{class}");
            for [u, v] in outline {
                let _infallible = write!(text, " {:.5} {:.5}", share(u, mask.width), share(v, mask.height));
            }
            text.push('\n');
        }
    }
    text
}

/// Frame with blur, and with white and black pixels.
fn changed(frame: &image::RgbImage, rng: &mut impl Rng) -> image::RgbImage {
    let mut image = imageops::blur(frame, rng.random_range(0.1..MOST_BLUR_PX));
    let salt = rng.random_range(0.0..MOST_SALT);
    for pixel in image.pixels_mut() {
        if rng.random_bool(salt) {
            *pixel = image::Rgb([if rng.random_bool(0.5) { 255 } else { 0 }; 3]);
        }
    }
    image
}

fn write(file: PathBuf, bytes: &[u8]) -> Result<()> {
    catenary_shell::files::write(&file, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_data_set_has_pictures_polygons_and_a_description() {
        let folder = tempfile::tempdir().unwrap();
        let image = RgbImage { width: 480, height: 480, data: vec![90; 3 * 480 * 480] };
        let mut mask = LabelMask::new(256, 256);
        for v in 100..110 {
            mask.data[v * 256 + 64..v * 256 + 192].fill(label::DLO);
        }
        prepare(folder.path()).unwrap();
        (0..5).for_each(|number| add(folder.path(), number, &image, &mask).unwrap());
        let count = |part: &str| std::fs::read_dir(folder.path().join(part)).unwrap().count();
        assert_eq!((count("images/train"), count("labels/train"), count("images/val")), (12, 12, 1));
        let text = std::fs::read_to_string(folder.path().join("labels/train/000_1.txt")).unwrap();
        assert_eq!(text, "0 0.25000 0.39062 0.75000 0.39062 0.75000 0.42969 0.25000 0.42969\n");
        assert!(prepare(folder.path()).unwrap_err().to_string().contains("without data.yaml"));
    }
}
