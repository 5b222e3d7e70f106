//! What every tracking backend does.

use catenary_core::{Keypoints, LabelMask};

use crate::Error;

/// Finds the keypoints of the object and the target in a mask.
pub trait KeypointTracker {
    /// The keypoints of `mask`, in its pixels.
    ///
    /// All coordinates are finite. The four keypoints of the object are a set: their order may flip between frames.
    /// Where the object is not seen, its scores are 0 and its keypoints lie in the middle of the mask; what to do then
    /// (hold the last ones, stop) is the caller's to decide.
    fn track(&mut self, mask: &LabelMask) -> Result<Keypoints, Error>;
}
