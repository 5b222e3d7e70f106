//! Image to label mask: colour segmentation of the deformable object and the target.
