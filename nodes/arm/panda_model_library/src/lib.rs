#![doc = include_str!("../README.md")]
#![allow(unsafe_code, reason = "C functions take pointers, and are found by their names")]
#![allow(non_snake_case, reason = "the names are those that libfranka looks up")]
#![allow(clippy::missing_safety_doc, reason = "one contract holds for all functions: see `Vector`")]

use franka::model::{FER_URDF, NativeBackend, RobotModelBackend};
use std::sync::OnceLock;

/// Array of a client. The contract of every function: it points to so many numbers, as `libfcimodels.h` of libfranka 0.9.2 says.
type Vector<const N: usize> = *const [f64; N];
/// Array of a client that takes a result: a matrix in column-major order.
type Output<const N: usize> = *mut [f64; N];

/// Joint positions of functions that do not depend on them: frame 1 does not move in itself.
const ANY_Q: [f64; 7] = [0.0; 7];

/// Computes a result with the model. Without a model, which the compiled-in URDF excludes, the result is zero.
fn with_model<const N: usize>(compute: impl FnOnce(&NativeBackend) -> [f64; N]) -> [f64; N] {
    static MODEL: OnceLock<Option<NativeBackend>> = OnceLock::new();
    MODEL.get_or_init(|| NativeBackend::from_urdf(FER_URDF).ok()).as_ref().map_or([0.0; N], compute)
}

/// Functions of the joint frames: pose, body Jacobian and zero Jacobian.
macro_rules! joint_frames {
    ($($joint:tt $pose:ident $body:ident $zero:ident),*) => {$(
        /// Pose of a joint frame in O.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $pose(q: Vector<7>, out: Output<16>) {
            // SAFETY: the contract at `Vector`.
            unsafe { *out = with_model(|m| m.pose(&*q, $joint)) }
        }
        joint_frames!(@jacobians $joint $body $zero);
    )*};
    // libfranka passes no joint positions for joint 1.
    (@jacobians 1 $body:ident $zero:ident) => {
        /// Body Jacobian of the frame of joint 1.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $body(out: Output<42>) {
            // SAFETY: the contract at `Vector`.
            unsafe { *out = with_model(|m| m.body_jacobian(&ANY_Q, 1)) }
        }
        /// Zero Jacobian of the frame of joint 1.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $zero(out: Output<42>) {
            // SAFETY: the contract at `Vector`.
            unsafe { *out = with_model(|m| m.zero_jacobian(&ANY_Q, 1)) }
        }
    };
    (@jacobians $joint:tt $body:ident $zero:ident) => {
        /// Body Jacobian of a joint frame.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $body(q: Vector<7>, out: Output<42>) {
            // SAFETY: the contract at `Vector`.
            unsafe { *out = with_model(|m| m.body_jacobian(&*q, $joint)) }
        }
        /// Zero Jacobian of a joint frame.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $zero(q: Vector<7>, out: Output<42>) {
            // SAFETY: the contract at `Vector`.
            unsafe { *out = with_model(|m| m.zero_jacobian(&*q, $joint)) }
        }
    };
}

joint_frames!(
    1 O_T_J1 Ji_J_J1 O_J_J1, 2 O_T_J2 Ji_J_J2 O_J_J2, 3 O_T_J3 Ji_J_J3 O_J_J3, 4 O_T_J4 Ji_J_J4 O_J_J4,
    5 O_T_J5 Ji_J_J5 O_J_J5, 6 O_T_J6 Ji_J_J6 O_J_J6, 7 O_T_J7 Ji_J_J7 O_J_J7
);

/// Pose of the flange in O.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn O_T_J8(q: Vector<7>, out: Output<16>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.pose_flange(&*q)) }
}

/// Body Jacobian of the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn Ji_J_J8(q: Vector<7>, out: Output<42>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.body_jacobian_flange(&*q)) }
}

/// Zero Jacobian of the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn O_J_J8(q: Vector<7>, out: Output<42>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.zero_jacobian_flange(&*q)) }
}

/// Pose in O of a frame that is fixed to the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn O_T_J9(q: Vector<7>, f_t_ee: Vector<16>, out: Output<16>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.pose_ee(&*q, &*f_t_ee)) }
}

/// Body Jacobian of a frame that is fixed to the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn Ji_J_J9(q: Vector<7>, f_t_ee: Vector<16>, out: Output<42>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.body_jacobian_ee(&*q, &*f_t_ee)) }
}

/// Zero Jacobian of a frame that is fixed to the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn O_J_J9(q: Vector<7>, f_t_ee: Vector<16>, out: Output<42>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.zero_jacobian_ee(&*q, &*f_t_ee)) }
}

/// Mass matrix, kg m^2, with a load at the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn M_NE(q: Vector<7>, inertia: Vector<9>, mass_kg: f64, centre: Vector<3>, out: Output<49>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.mass(&*q, &*inertia, mass_kg, &*centre)) }
}

/// Coriolis torques, N m, with a load at the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn c_NE(
    q: Vector<7>,
    dq: Vector<7>,
    inertia: Vector<9>,
    mass_kg: f64,
    centre: Vector<3>,
    out: Output<7>,
) {
    // Gravity cancels out of the Coriolis torques.
    let gravity = [0.0, 0.0, -9.81];
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.coriolis(&*q, &*dq, &*inertia, mass_kg, &*centre, &gravity)) }
}

/// Gravity torques, N m, with a load at the flange.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn g_NE(q: Vector<7>, gravity: Vector<3>, mass_kg: f64, centre: Vector<3>, out: Output<7>) {
    // SAFETY: the contract at `Vector`.
    unsafe { *out = with_model(|m| m.gravity(&*q, &*gravity, mass_kg, &*centre)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flange_lies_where_the_dimensions_of_the_arm_put_it() {
        // Straight arm: 0.333 + 0.316 + 0.384 up, 0.088 forward, 0.107 down (data sheet).
        let mut pose = [0.0; 16];
        // SAFETY: both arrays live.
        unsafe { O_T_J8(&[0.0; 7], &raw mut pose) };
        let expected = [0.088, 0.0, 0.333 + 0.316 + 0.384 - 0.107];
        assert!(pose[12..15].iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{pose:?}");
    }

    #[test]
    fn gravity_is_the_derivative_of_the_load_s_energy() {
        // The torques of a load of 1 kg at the flange are those that its weight has by the Jacobian.
        let q = [0.3, -0.7, 0.2, -2.0, 0.4, 1.8, 0.6];
        let (mut with, mut without, mut jacobian) = ([0.0; 7], [0.0; 7], [0.0; 42]);
        // SAFETY: all arrays live.
        unsafe {
            g_NE(&q, &[0.0, 0.0, -9.81], 1.0, &[0.0; 3], &raw mut with);
            g_NE(&q, &[0.0, 0.0, -9.81], 0.0, &[0.0; 3], &raw mut without);
            O_J_J8(&q, &raw mut jacobian);
        }
        for joint in 0..7 {
            let expected = 9.81 * jacobian[6 * joint + 2];
            assert!((with[joint] - without[joint] - expected).abs() < 1e-9, "joint {joint}");
        }
    }
}
