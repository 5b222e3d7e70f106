//! Images and label masks, row by row from the upper left corner.

use thiserror::Error;

/// Values of a label mask.
pub mod label {
    /// Neither the object nor the target.
    pub const BACKGROUND: u8 = 0;
    /// The deformable linear object.
    pub const DLO: u8 = 1;
    /// The target.
    pub const TARGET: u8 = 2;
}

/// Data that do not fill the image that they are said to be.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("an image of {width} x {height} pixels and a row step of {step} bytes needs {needed} bytes, got {got}")]
pub struct SizeError {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Bytes from one row to the next.
    pub step: usize,
    /// Bytes needed.
    pub needed: usize,
    /// Bytes given.
    pub got: usize,
}

/// A borrowed 8-bit RGB image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RgbView<'a> {
    width: u32,
    height: u32,
    step: usize,
    data: &'a [u8],
}

impl<'a> RgbView<'a> {
    /// A view of `data`: `height` rows of `width` RGB triples, `step` bytes from one row to the next.
    pub fn new(width: u32, height: u32, step: usize, data: &'a [u8]) -> Result<Self, SizeError> {
        let row = 3 * width as usize;
        let needed = (height as usize).saturating_sub(1) * step + if height == 0 { 0 } else { row };
        if step < row || data.len() < needed || width == 0 || height == 0 {
            return Err(SizeError { width, height, step, needed: needed.max(1), got: data.len() });
        }
        Ok(Self { width, height, step, data })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Row `v`: `width` RGB triples.
    pub fn row(&self, v: u32) -> &'a [u8] {
        let start = v as usize * self.step;
        &self.data[start..start + 3 * self.width as usize]
    }
}

/// An owned 8-bit RGB image without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `height` x `width` x 3 bytes.
    pub data: Vec<u8>,
}

impl RgbImage {
    /// A black image.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, data: vec![0; 3 * width as usize * height as usize] }
    }

    /// The image as a view.
    pub fn view(&self) -> RgbView<'_> {
        RgbView { width: self.width, height: self.height, step: 3 * self.width as usize, data: &self.data }
    }
}

/// A label mask without padding: one of [`label`] a pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelMask {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `height` x `width` bytes.
    pub data: Vec<u8>,
}

impl LabelMask {
    /// A mask of background.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, data: vec![label::BACKGROUND; width as usize * height as usize] }
    }

    /// A mask of `data`, which must be `height` x `width` bytes.
    pub fn from_data(width: u32, height: u32, data: Vec<u8>) -> Result<Self, SizeError> {
        let needed = width as usize * height as usize;
        if data.len() != needed || needed == 0 {
            return Err(SizeError { width, height, step: width as usize, needed, got: data.len() });
        }
        Ok(Self { width, height, data })
    }

    /// The label of the pixel in column `u`, row `v`.
    pub fn at(&self, u: u32, v: u32) -> u8 {
        self.data[v as usize * self.width as usize + u as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_check_their_size_and_skip_padding() {
        let data = [1, 2, 3, 9, 4, 5, 6, 9];
        let view = RgbView::new(1, 2, 4, &data).unwrap();
        assert_eq!(view.row(1), [4, 5, 6]);
        assert!(RgbView::new(1, 3, 4, &data).is_err());
        assert!(RgbView::new(2, 1, 4, &data).is_err());
        assert!(LabelMask::from_data(2, 2, vec![0; 3]).is_err());
    }
}
