//! Label mask to keypoints of the deformable object and the target.
