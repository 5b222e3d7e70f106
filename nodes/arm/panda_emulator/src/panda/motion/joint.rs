//! Joint-space path of a motion: differences of commands, their limits, extrapolation.

use crate::fci::{CYCLE_S, ErrorKind, Errors};
use crate::panda::chain::Joints;
use crate::panda::checks::limits::{Limits, exceeds};

/// Errors that a joint-space path raises. Their names depend on the channel of the command.
#[derive(Debug, Clone, Copy)]
pub struct PathErrors {
    position: ErrorKind,
    velocity: ErrorKind,
    acceleration: ErrorKind,
    jerk: ErrorKind,
    /// Relative tolerance for the rounding of the computation that leads to the path.
    tolerance: f64,
}

/// Errors of commanded joint positions. They are named one derivative above the channel: a jump of the speed is an acceleration.
pub const COMMANDED_POSITIONS: PathErrors = PathErrors {
    position: ErrorKind::JointMotionGeneratorPositionLimitsViolation,
    velocity: ErrorKind::JointMotionGeneratorVelocityLimitsViolation,
    acceleration: ErrorKind::JointMotionGeneratorVelocityDiscontinuity,
    jerk: ErrorKind::JointMotionGeneratorAccelerationDiscontinuity,
    tolerance: 0.0,
};
/// Errors of commanded joint speeds.
pub const COMMANDED_SPEEDS: PathErrors =
    PathErrors { acceleration: ErrorKind::JointMotionGeneratorAccelerationDiscontinuity, ..COMMANDED_POSITIONS };
/// Errors of the joint-space path behind a Cartesian command. The inverse kinematics leaves 1e-12 rad, thus a jerk of 1e-3 rad/s^3.
pub const FROM_CARTESIAN: PathErrors = PathErrors {
    position: ErrorKind::CartesianMotionGeneratorJointPositionLimitsViolation,
    velocity: ErrorKind::CartesianMotionGeneratorJointVelocityLimitsViolation,
    acceleration: ErrorKind::CartesianMotionGeneratorJointVelocityDiscontinuity,
    jerk: ErrorKind::CartesianMotionGeneratorJointAccelerationDiscontinuity,
    tolerance: 1e-6,
};

/// Last accepted point of a joint-space path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointPath {
    /// Angles, rad.
    pub q: Joints,
    /// Speeds, rad/s.
    pub dq: Joints,
    /// Accelerations, rad/s^2.
    pub ddq: Joints,
}

impl JointPath {
    /// Path at rest.
    pub fn at_rest(q: Joints) -> Self {
        Self { q, dq: Joints::zeros(), ddq: Joints::zeros() }
    }

    /// Goes on to angles, by backward differences. A step with errors is not taken.
    pub fn go_to(&mut self, q: Joints, limits: &Limits, names: &PathErrors) -> Errors {
        let dq = (q - self.q) / CYCLE_S;
        self.take(q, dq, limits, names)
    }

    /// Goes on at speeds, by backward differences. A step with errors is not taken.
    pub fn go_at(&mut self, dq: Joints, limits: &Limits, names: &PathErrors) -> Errors {
        self.take(self.q + dq * CYCLE_S, dq, limits, names)
    }

    /// Goes on at the last acceleration, for a lost command. The speed stays within its limits.
    pub fn extrapolate(&mut self, limits: &Limits) {
        let before = self.dq;
        self.dq = Joints::from_fn(|i, _| {
            let (low, high) = limits.speeds(i, self.q[i]);
            (before[i] + self.ddq[i] * CYCLE_S).min(high).max(low)
        });
        self.ddq = (self.dq - before) / CYCLE_S;
        self.q += self.dq * CYCLE_S;
    }

    fn take(&mut self, q: Joints, dq: Joints, limits: &Limits, names: &PathErrors) -> Errors {
        let ddq = (dq - self.dq) / CYCLE_S;
        let jerk = (ddq - self.ddq) / CYCLE_S;
        let slack = 1.0 + names.tolerance;
        let mut errors = Errors::default();
        for i in 0..7 {
            let rates = &limits.joints[i];
            let (low, high) = limits.speeds(i, q[i]);
            let most = if dq[i] < 0.0 { low } else { high };
            // An arm outside its range may come back.
            let outwards =
                (q[i] > limits.highest[i] && q[i] > self.q[i]) || (q[i] < limits.lowest[i] && q[i] < self.q[i]);
            if outwards {
                errors.insert(names.position);
            }
            if exceeds(dq[i], most.abs() * slack) {
                errors.insert(names.velocity);
            }
            if exceeds(ddq[i], rates.acceleration * slack) {
                errors.insert(names.acceleration);
            }
            if exceeds(jerk[i], rates.jerk * slack) {
                errors.insert(names.jerk);
            }
        }
        if errors.is_empty() {
            *self = Self { q, dq, ddq };
        }
        errors
    }
}
