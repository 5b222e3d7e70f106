//! Interface of tracking backends.

use catenary_core::image::label;
use catenary_core::{Keypoints, LabelMask};

use crate::Error;

/// Tracking of the keypoints of the object and the target in masks.
pub trait KeypointTracker {
    /// Keypoints of `mask` in its pixels.
    ///
    /// All coordinates are finite. The four keypoints of the object are a set: their order may flip between frames.
    /// If the object is not seen, its scores are 0 and its keypoints lie in the middle of the mask. The caller decides
    /// whether to hold the last keypoints or to stop.
    ///
    /// # Errors
    /// [`Error::Size`] if the bytes do not fill the mask; [`Error::UnknownLabel`] if one of them is no label.
    fn track(&mut self, mask: &LabelMask) -> Result<Keypoints, Error>;
}

/// Checks the size and the labels of a mask.
pub(crate) fn check(mask: &LabelMask) -> Result<(), Error> {
    let (width, height) = (mask.width, mask.height);
    if mask.data.is_empty() || mask.data.len() != width as usize * height as usize {
        return Err(Error::Size { width, height, got: mask.data.len() });
    }
    match mask.data.iter().position(|&l| l > label::TARGET) {
        None => Ok(()),
        Some(i) => {
            let (u, v) = (i % width as usize, i / width as usize);
            Err(Error::UnknownLabel { label: mask.data[i], u, v })
        }
    }
}
