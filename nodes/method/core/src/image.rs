//! Images and label masks, stored row by row from the upper left corner.

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

/// Data too short for the stated image size.
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

/// Borrowed 8-bit RGB image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RgbView<'a> {
    width: u32,
    height: u32,
    step: usize,
    data: &'a [u8],
}

impl<'a> RgbView<'a> {
    /// Views `data` as `height` rows of `width` RGB triples, with `step` bytes from one row to the next.
    ///
    /// # Errors
    /// [`SizeError`] if a row is longer than `step`, the data are too short, or a side is zero.
    pub fn new(width: u32, height: u32, step: usize, data: &'a [u8]) -> Result<Self, SizeError> {
        let row = 3 * width as usize;
        // The last row needs no padding behind it.
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

    /// `width` RGB triples of row `v`.
    pub fn row(&self, v: u32) -> &'a [u8] {
        let start = v as usize * self.step;
        &self.data[start..start + 3 * self.width as usize]
    }
}

/// Owned 8-bit RGB image without padding.
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
    /// Black image.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, data: vec![0; 3 * width as usize * height as usize] }
    }

    /// Borrowed view of the image.
    pub fn view(&self) -> RgbView<'_> {
        RgbView { width: self.width, height: self.height, step: 3 * self.width as usize, data: &self.data }
    }
}

/// Label mask without padding. Each pixel holds one value of [`label`].
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
    /// Mask in which every pixel is background.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, data: vec![label::BACKGROUND; width as usize * height as usize] }
    }

    /// Mask made of `data`, which must be `height` x `width` bytes.
    ///
    /// # Errors
    /// [`SizeError`] if the length differs or a side is zero.
    pub fn from_data(width: u32, height: u32, data: Vec<u8>) -> Result<Self, SizeError> {
        let needed = width as usize * height as usize;
        if data.len() != needed || needed == 0 {
            return Err(SizeError { width, height, step: width as usize, needed, got: data.len() });
        }
        Ok(Self { width, height, data })
    }

    /// Label of the pixel in column `u`, row `v`.
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
