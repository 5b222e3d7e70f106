//! Cartesian path of a motion: differences of commands, their limits, elbow, and the joint-space path behind them.

use super::inverse_kinematics::solve;
use super::joint::{FROM_CARTESIAN, JointPath};
use crate::fci::{CYCLE_S, ErrorKind, Errors};
use crate::panda::chain::{Frame, Joints, Six};
use crate::panda::checks::limits::{Limits, Rates, exceeds};

/// Angle of joint 4 at which the elbow changes its sign, rad (libfranka's documentation of `elbow`).
const ELBOW_FLIP_RAD: f64 = -0.467_002_423_653_011;

/// Elbow of joint angles: position of joint 3 (rad) and sign of joint 4.
pub fn elbow_of(q: &Joints) -> [f64; 2] {
    [q[2], if q[3] < ELBOW_FLIP_RAD { -1.0 } else { 1.0 }]
}

/// Last accepted point of a Cartesian path.
#[derive(Debug, Clone, Copy)]
pub struct CartesianPath {
    /// Pose of the end effector in O.
    pub pose: Frame,
    /// Twist in O, m/s and rad/s.
    pub twist: Six,
    /// Acceleration in O, m/s^2 and rad/s^2.
    pub acceleration: Six,
    /// Elbow: position of joint 3 (rad) and sign of joint 4.
    pub elbow: [f64; 2],
    /// Speed of joint 3, rad/s.
    pub elbow_speed_rad_s: f64,
    /// Acceleration of joint 3, rad/s^2.
    pub elbow_acceleration_rad_s2: f64,
    /// Joint-space path. An elbow that is not commanded stays where it was.
    pub joints: JointPath,
}

impl CartesianPath {
    /// Path at rest at joint angles and the pose of the end effector that belongs to them.
    pub fn at_rest(q: Joints, pose: Frame) -> Self {
        Self {
            pose,
            twist: Six::zeros(),
            acceleration: Six::zeros(),
            elbow: elbow_of(&q),
            elbow_speed_rad_s: 0.0,
            elbow_acceleration_rad_s2: 0.0,
            joints: JointPath::at_rest(q),
        }
    }

    /// Checks the first commanded pose and elbow against the start.
    pub fn start_errors(&self, pose: Option<&Frame>, elbow: Option<[f64; 2]>, tolerance: f64) -> Errors {
        let mut errors = Errors::default();
        if pose.is_some_and(|p| self.pose.step_to(p).amax() > tolerance) {
            errors.insert(ErrorKind::CartesianPositionMotionGeneratorStartPoseInvalid);
        }
        if let Some([position, sign]) = elbow {
            if exceeds(position - self.elbow[0], tolerance) {
                errors.insert(ErrorKind::CartesianMotionGeneratorStartElbowInvalid);
            }
            if sign != self.elbow[1] {
                errors.insert(ErrorKind::StartElbowSignInconsistent);
            }
        }
        errors
    }

    /// Goes on to a pose, by backward differences. A step with errors is not taken.
    pub fn go_to(&mut self, pose: &[f64; 16], elbow: Option<[f64; 2]>, limits: &Limits, tool: &Frame) -> Errors {
        if !Frame::is_valid(pose) {
            return Errors::of(ErrorKind::CartesianPositionMotionGeneratorInvalidFrame);
        }
        let pose = Frame::from_array(pose);
        let twist = self.pose.step_to(&pose) / CYCLE_S;
        self.take(pose, twist, elbow, (limits, tool), ErrorKind::CartesianMotionGeneratorVelocityDiscontinuity)
    }

    /// Goes on with a twist, by backward differences. A step with errors is not taken.
    pub fn go_at(&mut self, twist: Six, elbow: Option<[f64; 2]>, limits: &Limits, tool: &Frame) -> Errors {
        let pose = self.pose.moved(&twist, CYCLE_S);
        // Names go one derivative above the channel: a jump of a commanded speed is an acceleration.
        self.take(pose, twist, elbow, (limits, tool), ErrorKind::CartesianMotionGeneratorAccelerationDiscontinuity)
    }

    /// Goes on at the last acceleration, for a lost command. Speeds stay within their limits.
    pub fn extrapolate(&mut self, limits: &Limits, tool: &Frame) {
        let before = self.twist;
        let mut twist = before + self.acceleration * CYCLE_S;
        for (row, rates) in [(0, &limits.translation), (3, &limits.rotation)] {
            let norm = twist.fixed_rows::<3>(row).norm();
            if norm > rates.speed {
                let mut part = twist.fixed_rows_mut::<3>(row);
                part *= rates.speed / norm;
            }
        }
        let pose = self.pose.moved(&twist, CYCLE_S);
        let guess = self.joints.q + self.joints.dq * CYCLE_S;
        let Some(q) = solve(&pose, tool, &guess, self.elbow[0]) else { return };
        let dq = (q - self.joints.q) / CYCLE_S;
        self.joints = JointPath { q, dq, ddq: (dq - self.joints.dq) / CYCLE_S };
        (self.pose, self.twist, self.acceleration) = (pose, twist, (twist - before) / CYCLE_S);
        (self.elbow_speed_rad_s, self.elbow_acceleration_rad_s2) = (0.0, 0.0);
    }

    fn take(
        &mut self,
        pose: Frame,
        twist: Six,
        elbow: Option<[f64; 2]>,
        (limits, tool): (&Limits, &Frame),
        acceleration_error: ErrorKind,
    ) -> Errors {
        let acceleration = (twist - self.twist) / CYCLE_S;
        let jerk = (acceleration - self.acceleration) / CYCLE_S;
        let mut errors = Errors::default();
        for (row, rates) in [(0, &limits.translation), (3, &limits.rotation)] {
            let norm = |v: &Six| v.fixed_rows::<3>(row).norm();
            if exceeds(norm(&twist), rates.speed) {
                errors.insert(ErrorKind::CartesianMotionGeneratorVelocityLimitsViolation);
            }
            if exceeds(norm(&acceleration), rates.acceleration) {
                errors.insert(acceleration_error);
            }
            if exceeds(norm(&jerk), rates.jerk) {
                errors.insert(ErrorKind::CartesianMotionGeneratorAccelerationDiscontinuity);
            }
        }
        let mut next = *self;
        errors = errors.union(next.turn_elbow(elbow, limits));
        let guess = self.joints.q + self.joints.dq * CYCLE_S + self.joints.ddq * (0.5 * CYCLE_S * CYCLE_S);
        let Some(q) = solve(&pose, tool, &guess, next.elbow[0]) else {
            // At a singularity the joint speeds grow without bound.
            errors.insert(ErrorKind::CartesianMotionGeneratorJointVelocityLimitsViolation);
            return errors;
        };
        if errors.is_empty() {
            errors = next.joints.go_to(q, limits, &FROM_CARTESIAN);
        }
        if errors.is_empty() {
            *self = Self { pose, twist, acceleration, ..next };
        }
        errors
    }

    /// Follows a commanded elbow and returns its errors. An elbow that is not commanded stays.
    fn turn_elbow(&mut self, elbow: Option<[f64; 2]>, limits: &Limits) -> Errors {
        let [position, sign] = elbow.unwrap_or(self.elbow);
        let speed = (position - self.elbow[0]) / CYCLE_S;
        let acceleration = (speed - self.elbow_speed_rad_s) / CYCLE_S;
        let jerk = (acceleration - self.elbow_acceleration_rad_s2) / CYCLE_S;
        let mut errors = Errors::default();
        let Rates { speed: most, acceleration: most_acceleration, jerk: most_jerk } = limits.elbow;
        let in_range = (limits.lowest[2]..=limits.highest[2]).contains(&position);
        let fast = exceeds(speed, most) || exceeds(acceleration, most_acceleration) || exceeds(jerk, most_jerk);
        if elbow.is_some() && (fast || !in_range) {
            errors.insert(ErrorKind::CartesianMotionGeneratorElbowLimitViolation);
        }
        if sign != self.elbow[1] {
            errors.insert(ErrorKind::CartesianMotionGeneratorElbowSignInconsistent);
        }
        self.elbow[0] = position;
        (self.elbow_speed_rad_s, self.elbow_acceleration_rad_s2) = (speed, acceleration);
        errors
    }
}
