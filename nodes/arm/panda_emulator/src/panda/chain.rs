//! Kinematic chain of the arm: frames of the joints, Jacobian, frames and rotations.
//!
//! Denavit-Hartenberg parameters in Craig's convention, as published by Franka Emika. Panda and Franka Research 3 share them.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Vector over the joints.
pub type Joints = SVector<f64, 7>;
/// Matrix over the joints.
pub type JointMatrix = SMatrix<f64, 7, 7>;
/// Jacobian: rows are translation, then rotation, in the axes of O.
pub type Jacobian = SMatrix<f64, 6, 7>;
/// Wrench or twist: translation, then rotation.
pub type Six = SVector<f64, 6>;

/// Parameters a (m), d (m) and quarter turns alpha about x of each joint.
const DH: [(f64, f64, f64); 7] = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -1.0),
    (0.0, 0.316, 1.0),
    (0.0825, 0.0, 1.0),
    (-0.0825, 0.384, -1.0),
    (0.0, 0.0, 1.0),
    (0.088, 0.0, 1.0),
];
/// Distance of the flange beyond joint 7, m.
const FLANGE_M: f64 = 0.107;
/// Maximum error of a rotation matrix and of the last row of a pose: the control box refuses larger ones as
/// `cartesian_position_motion_generator_invalid_frame` (libfranka's own check of a pose).
const FRAME_TOLERANCE: f64 = 1e-5;

/// Rigid frame: rotation, then origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Axes of the frame as columns.
    pub rotation: Matrix3<f64>,
    /// Origin, m.
    pub origin: Vector3<f64>,
}

impl Frame {
    /// Frame at the origin of its parent.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), origin: Vector3::zeros() }
    }

    /// Reads a column-major 4x4 matrix without a check.
    pub fn from_array(m: &[f64; 16]) -> Self {
        Self {
            rotation: Matrix3::new(m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]),
            origin: Vector3::new(m[12], m[13], m[14]),
        }
    }

    /// Returns true if the column-major matrix is a rigid frame within the tolerance of the control box.
    pub fn is_valid(m: &[f64; 16]) -> bool {
        let rotation = Self::from_array(m).rotation;
        let last_row = [m[3], m[7], m[11], m[15] - 1.0];
        let skewed = rotation.transpose() * rotation - Matrix3::identity();
        m.iter().all(|v| v.is_finite())
            && last_row.iter().all(|v| v.abs() <= FRAME_TOLERANCE)
            && skewed.iter().all(|v| v.abs() <= FRAME_TOLERANCE)
            && rotation.determinant() > 0.0
    }

    /// Returns the column-major 4x4 matrix.
    pub fn to_array(self) -> [f64; 16] {
        let (r, p) = (&self.rotation, &self.origin);
        [
            r[(0, 0)],
            r[(1, 0)],
            r[(2, 0)],
            0.0,
            r[(0, 1)],
            r[(1, 1)],
            r[(2, 1)],
            0.0,
            r[(0, 2)],
            r[(1, 2)],
            r[(2, 2)],
            0.0,
            p.x,
            p.y,
            p.z,
            1.0,
        ]
    }

    /// Frame `inner`, given in this frame, in the parent of this frame.
    pub fn then(&self, inner: &Self) -> Self {
        Self { rotation: self.rotation * inner.rotation, origin: self.at(&inner.origin) }
    }

    /// Point given in this frame, in the parent of this frame.
    pub fn at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.origin
    }

    /// Step from `self` to `target`: translation (m) and rotation vector (rad) in the axes of the parent.
    pub fn step_to(&self, target: &Self) -> Six {
        let move_m = target.origin - self.origin;
        let turn = rotation_vector(&(target.rotation * self.rotation.transpose()));
        Six::new(move_m.x, move_m.y, move_m.z, turn.x, turn.y, turn.z)
    }

    /// Frame moved by a twist of the parent's axes over a time.
    pub fn moved(&self, twist: &Six, time_s: f64) -> Self {
        let turn = twist.fixed_rows::<3>(3) * time_s;
        Self {
            rotation: rotation_of(&Vector3::new(turn[0], turn[1], turn[2])) * self.rotation,
            origin: self.origin + twist.fixed_rows::<3>(0) * time_s,
        }
    }
}

/// Rotation vector of a rotation matrix, rad. Exact for small rotations, where the arc cosine of the trace is not.
fn rotation_vector(r: &Matrix3<f64>) -> Vector3<f64> {
    let sine = 0.5 * Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
    let (norm, cosine) = (sine.norm(), 0.5 * (r.trace() - 1.0));
    if norm < 1e-9 { sine } else { sine * (norm.atan2(cosine) / norm) }
}

/// Rotation matrix of a rotation vector, rad (Rodrigues).
fn rotation_of(vector: &Vector3<f64>) -> Matrix3<f64> {
    let angle = vector.norm();
    let k = vector.cross_matrix();
    if angle < 1e-9 {
        return Matrix3::identity() + k;
    }
    Matrix3::identity() + k * (angle.sin() / angle) + k * k * ((1.0 - angle.cos()) / (angle * angle))
}

/// Frames of the seven joints and of the flange in O.
#[derive(Debug, Clone, Copy)]
pub struct Chain {
    /// Frames of the joints.
    pub joints: [Frame; 7],
    /// Frame of the flange.
    pub flange: Frame,
}

impl Chain {
    /// Frames at joint angles `q`, rad.
    pub fn at(q: &Joints) -> Self {
        let mut joints = [Frame::identity(); 7];
        let mut current = Frame::identity();
        for (i, (a, d, quarter)) in DH.iter().enumerate() {
            let (sine, cosine) = q[i].sin_cos();
            // Cosine and sine of alpha, exactly: in floating point, cos(pi / 2) is 6e-17.
            let (ca, sa) = (1.0 - quarter.abs(), *quarter);
            let local = Frame {
                rotation: Matrix3::new(cosine, -sine, 0.0, sine * ca, cosine * ca, -sa, sine * sa, cosine * sa, ca),
                origin: Vector3::new(*a, -sa * d, ca * d),
            };
            current = current.then(&local);
            joints[i] = current;
        }
        let flange = Frame { origin: current.at(&Vector3::new(0.0, 0.0, FLANGE_M)), ..current };
        Self { joints, flange }
    }

    /// Jacobian of a point (m, in O) that joint 7 carries.
    pub fn jacobian(&self, point: &Vector3<f64>) -> Jacobian {
        let mut jacobian = Jacobian::zeros();
        for (i, frame) in self.joints.iter().enumerate() {
            let axis: Vector3<f64> = frame.rotation.column(2).into();
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&axis.cross(&(point - frame.origin)));
            jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&axis);
        }
        jacobian
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use franka::model::{FER_URDF, FR3_URDF, Frame as ModelFrame, Model};

    #[test]
    fn chain_agrees_with_the_models_of_both_generations() {
        let tool = Frame { origin: Vector3::new(0.01, -0.02, 0.1034), ..Frame::identity() };
        for urdf in [FER_URDF, FR3_URDF] {
            let model = Model::from_urdf(urdf).unwrap();
            for k in 0..50 {
                let q = Joints::from_fn(|i, _| (1.3 * f64::from(k) + 2.1 * i as f64).sin() * 2.5);
                let chain = Chain::at(&q);
                let hand = chain.flange.then(&tool);
                let identity = crate::fci::IDENTITY;
                let pose = model.pose_q(ModelFrame::EndEffector, &q.into(), &tool.to_array(), &identity);
                let columns = model.zero_jacobian_q(ModelFrame::EndEffector, &q.into(), &tool.to_array(), &identity);
                let jacobian = chain.jacobian(&hand.origin);
                for (got, want) in hand.to_array().iter().zip(pose) {
                    assert!((got - want).abs() < 1e-12, "pose {got} {want}");
                }
                for (got, want) in jacobian.as_slice().iter().zip(columns) {
                    assert!((got - want).abs() < 1e-12, "jacobian {got} {want}");
                }
            }
        }
    }

    #[test]
    fn step_to_inverts_moved_for_small_and_large_rotations() {
        for turn in [1e-12, 1e-6, 0.3, 2.0] {
            let twist = Six::new(0.1, -0.2, 0.3, turn, -0.5 * turn, 0.2 * turn);
            let step = Frame::identity().step_to(&Frame::identity().moved(&twist, 1.0));
            assert!((step - twist).norm() < 1e-14 + 1e-12 * turn, "{step:?}");
        }
    }

    #[test]
    fn matrices_that_are_no_frames_are_refused() {
        let mut matrix = crate::fci::IDENTITY;
        assert!(Frame::is_valid(&matrix));
        matrix[0] += 2e-5;
        assert!(!Frame::is_valid(&matrix));
    }
}
