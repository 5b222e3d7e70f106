//! Poses of the end effector.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// How far a quaternion's norm may be from 1.
const NORM_TOLERANCE: f64 = 1e-2;

/// Pose of panda_hand_tcp in panda_link0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPose {
    /// (x, y, z) in m.
    pub position_m: [f64; 3],
    /// Orientation (x, y, z, w), unit norm.
    pub quaternion_xyzw: [f64; 4],
}

impl ArmPose {
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.position_m.iter().chain(&self.quaternion_xyzw).all(|v| v.is_finite())
    }

    /// Whether the quaternion has unit norm, to within what single precision and rounding leave.
    pub fn is_normalised(&self) -> bool {
        let norm = self.quaternion_xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
        (norm - 1.0).abs() <= NORM_TOLERANCE
    }

    /// Distance in m between the positions.
    pub fn distance_m(&self, other: &ArmPose) -> f64 {
        (Vector3::from(self.position_m) - Vector3::from(other.position_m)).norm()
    }

    /// Angle in rad of the rotation between the orientations.
    pub fn angle_rad(&self, other: &ArmPose) -> f64 {
        self.rotation().angle_to(&other.rotation())
    }

    /// The orientation.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        let [x, y, z, w] = self.quaternion_xyzw;
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }

    /// A pose of this position and orientation.
    pub fn from_parts(position_m: [f64; 3], rotation: &UnitQuaternion<f64>) -> Self {
        let q = rotation.quaternion();
        Self { position_m, quaternion_xyzw: [q.i, q.j, q.k, q.w] }
    }
}
