//! Poses of the end effector.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// Tolerated deviation of a quaternion's norm from 1: single precision and rounding to a few digits pass.
const NORM_TOLERANCE: f64 = 1e-2;

/// Pose of panda_hand_tcp in panda_link0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPose {
    /// Position (x, y, z), m.
    pub position_m: [f64; 3],
    /// Orientation (x, y, z, w), of unit norm.
    pub quaternion_xyzw: [f64; 4],
}

impl ArmPose {
    /// Returns true if every number is finite.
    pub fn is_finite(&self) -> bool {
        self.position_m.iter().chain(&self.quaternion_xyzw).all(|v| v.is_finite())
    }

    /// Returns true if the quaternion has unit norm within the tolerance of 1 %.
    pub fn is_normalised(&self) -> bool {
        let norm = self.quaternion_xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
        (norm - 1.0).abs() <= NORM_TOLERANCE
    }

    /// Returns the distance between the positions, m.
    pub fn distance_m(&self, other: &ArmPose) -> f64 {
        (Vector3::from(self.position_m) - Vector3::from(other.position_m)).norm()
    }

    /// Returns the angle of the rotation between the orientations, rad.
    pub fn angle_rad(&self, other: &ArmPose) -> f64 {
        self.rotation().angle_to(&other.rotation())
    }

    /// Returns the orientation, normalised.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        let [x, y, z, w] = self.quaternion_xyzw;
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }

    /// Returns the pose as a transform.
    pub fn isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.position_m), self.rotation())
    }

    /// Creates a pose from position (m) and orientation.
    pub fn from_parts(position_m: [f64; 3], rotation: &UnitQuaternion<f64>) -> Self {
        let q = rotation.quaternion();
        Self { position_m, quaternion_xyzw: [q.i, q.j, q.k, q.w] }
    }
}
