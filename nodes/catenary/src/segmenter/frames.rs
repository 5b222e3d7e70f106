//! Folder of labelled frames: `NNN.png` with `NNN_mask.png`, white where the object is and grey where the target is.

use crate::exit::{Given, WrongInput};
use crate::mask::frames::picture;
use anyhow::{Context, Result};
use camera::learned::LabelledFrame;
use catenary_core::image::label;
use catenary_core::{LabelMask, RgbImage};
use image::ExtendedColorType;
use std::path::{Path, PathBuf};

/// Grey levels of background, object and target.
const LEVELS: [(u8, u8); 3] = [(label::BACKGROUND, 0), (label::DLO, 255), (label::TARGET, 128)];
/// Ending of the name of a frame's labels.
const MASK: &str = "_mask.png";

/// Creates the folder. One that holds labels already is refused: they may be corrected ones.
pub fn prepare(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string()).given()?;
    if masks(folder)?.is_empty() {
        return Ok(());
    }
    Err(WrongInput::error(format!("--out {}: expected a folder without labels, got one with them", folder.display())))
}

/// The square of an image, with the same pixels.
pub fn cut(image: &RgbImage, [left, top, side]: [f64; 3]) -> RgbImage {
    let [left, top, side] = [left, top, side].map(|edge| edge.round() as u32);
    let side = side.min(image.width - left).min(image.height - top).max(1);
    let view = image.view();
    let row = |v: u32| view.row(v)[3 * left as usize..3 * (left + side) as usize].to_vec();
    RgbImage { width: side, height: side, data: (top..top + side).flat_map(row).collect() }
}

/// Writes a frame and its labels, in the frame's size.
pub fn write(folder: &Path, number: usize, image: &RgbImage, mask: &LabelMask) -> Result<()> {
    let file = folder.join(format!("{number:03}.png"));
    image::save_buffer(&file, &image.data, image.width, image.height, ExtendedColorType::Rgb8)
        .with_context(|| file.display().to_string())?;
    let at = |i: u32, size: u32, of: u32| (u64::from(i) * u64::from(of) / u64::from(size)) as usize;
    let level = |v: u32, u: u32| {
        let label = mask.data[at(v, image.height, mask.height) * mask.width as usize + at(u, image.width, mask.width)];
        LEVELS.iter().find(|(l, _)| *l == label).map_or(0, |(_, level)| *level)
    };
    let levels: Vec<u8> = (0..image.height).flat_map(|v| (0..image.width).map(move |u| level(v, u))).collect();
    let file = folder.join(format!("{number:03}{MASK}"));
    image::save_buffer(&file, &levels, image.width, image.height, ExtendedColorType::L8)
        .with_context(|| file.display().to_string())
}

/// Frames of a folder.
pub fn read(folder: &Path) -> Result<Vec<LabelledFrame>> {
    let masks = masks(folder)?;
    if masks.is_empty() {
        let name = folder.display();
        return Err(WrongInput::error(format!("--frames {name}: expected NNN.png with NNN{MASK}, found none")));
    }
    masks.iter().map(|mask| frame(mask)).collect()
}

fn frame(mask: &Path) -> Result<LabelledFrame> {
    let name = mask.to_string_lossy();
    let image = picture(&PathBuf::from(name.replace(MASK, ".png")))?.image;
    let labels = picture(mask)?.image;
    if [labels.width, labels.height] != [image.width, image.height] {
        let (w, h) = (image.width, image.height);
        let got = format!("{} x {}", labels.width, labels.height);
        return Err(WrongInput::error(format!("labels {name}: expected {w} x {h} pixels, as the frame, got {got}")));
    }
    // The nearest level counts: paint programs blur edges.
    let nearest = |grey: u8| LEVELS.iter().min_by_key(|(_, level)| level.abs_diff(grey)).map_or(0, |(label, _)| *label);
    let labels: Vec<u8> = labels.data.chunks_exact(3).map(|rgb| nearest(rgb[0])).collect();
    LabelledFrame::new(image.view(), &labels).with_context(|| format!("labels {name}")).given()
}

/// Files of labels, in the order of their names.
fn masks(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = std::fs::read_dir(folder).with_context(|| format!("folder {}", folder.display())).given()?;
    let mut found: Vec<PathBuf> = read.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    found.retain(|path| path.to_string_lossy().ends_with(MASK));
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_survive_the_folder_and_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let image = RgbImage { width: 64, height: 48, data: vec![90; 3 * 64 * 48] };
        let square = cut(&image, [8.0, 0.0, 48.0]);
        assert_eq!([square.width, square.height], [48, 48]);
        let mut mask = LabelMask::new(16, 16);
        mask.data[40..50].fill(label::DLO);
        prepare(folder.path()).unwrap();
        write(folder.path(), 0, &square, &mask).unwrap();
        assert_eq!(read(folder.path()).unwrap().len(), 1);
        assert!(prepare(folder.path()).unwrap_err().to_string().contains("expected a folder without labels"));
    }

    #[test]
    fn an_empty_folder_and_labels_without_object_are_named() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read(folder.path()).unwrap_err().to_string().contains("found none"));
        let image = RgbImage { width: 48, height: 48, data: vec![90; 3 * 48 * 48] };
        write(folder.path(), 7, &image, &LabelMask::new(16, 16)).unwrap();
        let error = format!("{:#}", read(folder.path()).unwrap_err());
        assert!(error.contains("007_mask.png") && error.contains("of the object"), "{error}");
    }
}
