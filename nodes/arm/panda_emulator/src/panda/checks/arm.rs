//! Checks of the measured arm, whatever moves it.

use super::limits::{Limits, exceeds};
use crate::fci::{ErrorKind, Errors};
use crate::panda::chain::{Frame, Joints};
use crate::panda::plant::sensors::Readings;
use crate::panda::settings::Settings;
use nalgebra::Vector3;

/// Joint speed that counts as motion out of the range, rad/s. Chosen above the noise of the speeds: an arm at rest outside its
/// range may be brought back.
const OUTWARD_RAD_S: f64 = 5e-3;

/// Returns the errors of the measured arm. `hand`: pose of the end effector. `hand_speed_m_s`: its speed.
pub fn errors(readings: &Readings, hand: &Frame, hand_speed_m_s: f64, limits: &Limits, settings: &Settings) -> Errors {
    let mut errors = Errors::default();
    for i in 0..7 {
        let (q, dq) = (readings.q[i], readings.dq[i]);
        let (low, high) = limits.speeds(i, q);
        let margin = settings.joint_speed_margin_rad_s;
        if dq > high + margin || dq < low - margin {
            errors.insert(ErrorKind::JointVelocityViolation);
        }
        let outwards = (q > limits.highest[i] && dq > OUTWARD_RAD_S) || (q < limits.lowest[i] && dq < -OUTWARD_RAD_S);
        if outwards {
            errors.insert(ErrorKind::JointPositionLimitsViolation);
        }
    }
    if exceeds(hand_speed_m_s, settings.hand_speed_m_s + settings.hand_speed_margin_m_s) {
        errors.insert(ErrorKind::CartesianVelocityViolation);
    }
    if power_w(&readings.tau, &readings.dq) > settings.power_limit_w {
        errors.insert(ErrorKind::PowerLimitViolation);
    }
    if settings.checks_torque_range && limits.torque_is_outside(&readings.tau) {
        errors.insert(ErrorKind::TauJRangeViolation);
    }
    if settings.workspace_box.is_some_and(|(size, frame)| leaves(&hand.origin, &size, &frame)) {
        errors.insert(ErrorKind::CartesianPositionLimitsViolation);
    }
    errors
}

fn power_w(tau: &Joints, dq: &Joints) -> f64 {
    tau.component_mul(dq).abs().sum()
}

fn leaves(point: &Vector3<f64>, size: &[f64; 3], frame: &[f64; 16]) -> bool {
    let frame = Frame::from_array(frame);
    let inside = frame.rotation.tr_mul(&(point - frame.origin));
    inside.iter().zip(size).any(|(v, s)| v.abs() > 0.5 * s)
}
