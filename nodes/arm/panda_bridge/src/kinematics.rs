//! Kinematics of the Panda with its hand.
//!
//! Denavit-Hartenberg parameters in Craig's convention, as published by Franka Emika: a, d and alpha of each joint, the flange,
//! and the tool centre point of the hand, 0.1034 m beyond the flange and turned by -45 degrees.

use crate::pose::ArmPose;
use nalgebra::{Isometry3, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3, Vector6};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Number of joints.
pub const JOINTS: usize = 7;
/// Ready pose of Franka Emika: in front of the base, with the tool pointing down, rad.
pub const READY_RAD: [f64; JOINTS] = [0.0, -FRAC_PI_4, 0.0, -3.0 * FRAC_PI_4, 0.0, FRAC_PI_2, FRAC_PI_4];
/// Joint limits as published by Franka Emika, rad.
pub const LIMITS_RAD: [[f64; 2]; JOINTS] = [
    [-2.8973, 2.8973],
    [-1.7628, 1.7628],
    [-2.8973, 2.8973],
    [-3.0718, -0.0698],
    [-2.8973, 2.8973],
    [-0.0175, 3.7525],
    [-2.8973, 2.8973],
];

/// Parameters a (m), d (m) and alpha (rad) of each joint.
const DH: [[f64; 3]; JOINTS] = [
    [0.0, 0.333, 0.0],
    [0.0, 0.0, -FRAC_PI_2],
    [0.0, 0.316, FRAC_PI_2],
    [0.0825, 0.0, FRAC_PI_2],
    [-0.0825, 0.384, -FRAC_PI_2],
    [0.0, 0.0, FRAC_PI_2],
    [0.088, 0.0, FRAC_PI_2],
];
/// Distance from the last joint to the flange along the joint's axis, m.
const FLANGE_M: f64 = 0.107;
/// Distance from the flange to the tool centre point of the hand, m.
const TOOL_M: f64 = 0.1034;
/// Damping of the least squares. Chosen: small against the singular values of the Jacobian inside the workspace.
const DAMPING: f64 = 1e-3;
/// Maximum number of iterations. Chosen: a start near the solution needs a handful.
const MAX_ITERATIONS: usize = 50;
/// Residual of position (m) and rotation (rad) at which the iteration has converged.
const TOLERANCE: f64 = 1e-6;

fn joint_frame(joint: usize, angle_rad: f64) -> Isometry3<f64> {
    let [a, d, alpha] = DH[joint];
    let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), alpha);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad);
    Isometry3::from_parts(Translation3::new(a, 0.0, 0.0), twist)
        * Isometry3::from_parts(Translation3::new(0.0, 0.0, d), turn)
}

/// Returns the frames of the joints, followed by the frame of the tool.
fn frames(joints_rad: &[f64; JOINTS]) -> [Isometry3<f64>; JOINTS + 1] {
    let mut frames = [Isometry3::identity(); JOINTS + 1];
    let mut current = Isometry3::identity();
    for (i, angle) in joints_rad.iter().enumerate() {
        current *= joint_frame(i, *angle);
        frames[i] = current;
    }
    frames[JOINTS] = current * Translation3::new(0.0, 0.0, FLANGE_M) * flange_from_tool();
    frames
}

/// Returns the pose of the hand's tool centre point (panda_hand_tcp) in the frame of the flange.
#[must_use]
pub fn flange_from_tool() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_4);
    Isometry3::from_parts(Translation3::new(0.0, 0.0, TOOL_M), turn)
}

/// Returns the Jacobian of the tool centre point in the base frame: linear rows, then angular rows.
#[must_use]
pub fn jacobian(joints_rad: &[f64; JOINTS]) -> SMatrix<f64, 6, JOINTS> {
    jacobian_of(&frames(joints_rad))
}

fn jacobian_of(frames: &[Isometry3<f64>; JOINTS + 1]) -> SMatrix<f64, 6, JOINTS> {
    let tool = frames[JOINTS].translation.vector;
    let mut jacobian = SMatrix::<f64, 6, JOINTS>::zeros();
    for (i, frame) in frames[..JOINTS].iter().enumerate() {
        let axis = frame.rotation * Vector3::z();
        let lever = tool - frame.translation.vector;
        jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&axis.cross(&lever));
        jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&axis);
    }
    jacobian
}

/// Returns the pose of the tool centre point for these joint angles, rad.
pub fn forward(joints_rad: &[f64; JOINTS]) -> ArmPose {
    let tool = frames(joints_rad)[JOINTS];
    let t = tool.translation.vector;
    ArmPose::from_parts([t.x, t.y, t.z], &tool.rotation)
}

/// Returns joint angles (rad) near `start_rad` that bring the tool to `pose`, by damped least squares. Returns `None` if the
/// iteration does not converge or its solution violates a joint limit.
pub fn inverse(pose: &ArmPose, start_rad: &[f64; JOINTS]) -> Option<[f64; JOINTS]> {
    let mut q = *start_rad;
    for _ in 0..MAX_ITERATIONS {
        let frames = frames(&q);
        let tool = frames[JOINTS];
        let move_m = Vector3::from(pose.position_m) - tool.translation.vector;
        let turn_rad = (pose.rotation() * tool.rotation.inverse()).scaled_axis();
        let error = Vector6::from_iterator(move_m.iter().chain(turn_rad.iter()).copied());
        if error.norm() < TOLERANCE {
            let within = q.iter().zip(LIMITS_RAD).all(|(v, [low, high])| (low..=high).contains(v));
            return within.then_some(q);
        }
        let jacobian = jacobian_of(&frames);
        let square = jacobian * jacobian.transpose() + Matrix6::identity() * (DAMPING * DAMPING);
        let step = jacobian.transpose() * square.cholesky()?.solve(&error);
        for (angle, delta) in q.iter_mut().zip(step.iter()) {
            // The linearisation holds for small steps only. 0.3 rad was chosen.
            *angle += delta.clamp(-0.3, 0.3);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ready_pose_is_the_published_one() {
        let pose = forward(&READY_RAD);
        let expected = [0.3069, 0.0, 0.4869];
        for (got, want) in pose.position_m.iter().zip(expected) {
            assert!((got - want).abs() < 1e-3, "{pose:?}");
        }
        let down = pose.rotation() * Vector3::z();
        assert!((down.z + 1.0).abs() < 1e-9, "the tool points down: {down:?}");
    }

    #[test]
    fn forward_of_inverse_returns_the_wanted_pose() {
        let mut q = READY_RAD;
        for k in 0..20 {
            let x = 0.3 + 0.015 * f64::from(k);
            let wanted =
                ArmPose { position_m: [x, 0.0, 0.45 - 0.01 * f64::from(k)], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] };
            q = inverse(&wanted, &q).expect("inside the workspace");
            let got = forward(&q);
            assert!(got.distance_m(&wanted) < 1e-6 && got.angle_rad(&wanted) < 1e-5, "{got:?}");
        }
        let far = ArmPose { position_m: [2.0, 0.0, 0.3], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] };
        assert_eq!(inverse(&far, &READY_RAD), None);
    }
}
