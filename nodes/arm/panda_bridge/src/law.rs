//! Cartesian impedance law of an arm that is driven by torques, with the barriers around it. Pure: no clock, no robot.
//!
//! The law is that of SERL (Luo et al. 2024, `serl_franka_controllers`), whose gains and clips laboratories know:
//!
//! ```text
//! tau = J^T (-K e - D J dq - Ki sum(e)) + (I - J^T pinv(J^T)) (kn (q0 - q) - 2 sqrt(kn) dq) + coriolis
//! ```
//!
//! The error e is clipped per axis, so that the steady force is at most stiffness times clip. The target and the gains are low-passed
//! after each cycle: a step of the target reaches the law within some 0.2 s.
//!
//! It differs from SERL's in three points. The target follows no faster than a speed limit, and a force that drives the hand beyond that
//! limit fades out. The posture q0 is kept from motion to motion, and its spring is stiff enough for stiction: SERL takes the measured
//! joints anew, so that the elbow creeps with every loop of the hand. The pseudo-inverse is damped a tenth as much, so that this spring
//! does not pull at the hand.

mod barriers;

pub use barriers::{Barriers, JointLimits};

use crate::compliance::{Compliance, ROTATION_CLIP};
use crate::kinematics::JOINTS;
use crate::speed::{CYCLE_S, FILTER, SpeedLimit};
use nalgebra::{Isometry3, Matrix6, SMatrix, SVector, Vector3, Vector6};

/// Vector of joint values.
pub type Joints = SVector<f64, JOINTS>;
/// Jacobian of the end effector in the base frame: linear rows, then angular rows.
pub type Jacobian = SMatrix<f64, 6, JOINTS>;

/// Damping of the pseudo-inverse. Chosen: SERL's 0.2 lets 30 % of the posture's torque through to the hand where the smallest singular value
/// is 0.3, this lets 0.4 %.
const PSEUDO_INVERSE_DAMPING: f64 = 0.02;
/// Speed at which the posture in force approaches the wanted one, rad/s. Chosen, above that of a move to the start.
const POSTURE_RAD_S: f64 = 0.5;
/// Greatest torque of the posture's spring (norm over the joints), N m. Chosen: an elbow that is pushed or far from its posture is pulled
/// with less than the lowest default threshold of a joint.
const MAX_POSTURE_N_M: f64 = 6.0;
/// Distance in the null space up to which a motion keeps the posture of the last one, rad. Chosen: stiction leaves less than 0.05 rad, and
/// an arm that was guided by hand since must not swing its elbow back.
const MAX_KEPT_RAD: f64 = 0.25;
/// Limits of the summed error: translation in m, rotation as the sine of half the angle (SERL).
const MAX_SUM: [f64; 2] = [0.1, 0.3];

/// Measured state that the law needs.
#[derive(Debug, Clone)]
pub struct ArmMotion {
    /// Joint angles, rad.
    pub q: Joints,
    /// Joint velocities, rad/s.
    pub dq: Joints,
    /// Pose of the end effector in the base frame.
    pub pose: Isometry3<f64>,
    /// Jacobian at the end effector.
    pub jacobian: Jacobian,
    /// Coriolis torques, N m.
    pub coriolis: Joints,
}

/// Gains beside the compliance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawSettings {
    /// Integral gain, N/m and N m per cycle; 0 leaves the standing error of friction.
    pub integral: f64,
    /// Stiffness of the null space, N m/rad. A larger one keeps the elbow nearer to its posture, against more stiction.
    pub nullspace_stiffness: f64,
    /// Factor of the null-space stiffness of joint 1.
    pub joint1_factor: f64,
    /// Greatest speed of the hand on the way to a target.
    pub speed: SpeedLimit,
}

impl Default for LawSettings {
    fn default() -> Self {
        // Integral gain of SERL's controller. SERL's null space has 0.2 N m/rad, and 100 times that for joint 1. Stiction of 0.2 N m a joint
        // holds about 0.4 N m along the null space, so that 20 N m/rad keep the elbow to some 0.02 rad.
        Self { integral: 0.0, nullspace_stiffness: 20.0, joint1_factor: 1.0, speed: SpeedLimit::default() }
    }
}

/// Impedance law with its filtered target and gains.
#[derive(Debug, Clone)]
pub struct ImpedanceLaw {
    settings: LawSettings,
    /// Posture that the null space pulls to now, rad.
    rest_rad: Joints,
    /// Posture that it approaches, rad.
    posture_rad: Joints,
    goal: Isometry3<f64>,
    target: Isometry3<f64>,
    wanted: Compliance,
    gains: Compliance,
    sum: Vector6<f64>,
}

impl ImpedanceLaw {
    /// Creates a law that holds the arm where it is.
    #[must_use]
    pub fn new(settings: LawSettings, compliance: Compliance, motion: &ArmMotion) -> Self {
        Self {
            settings,
            rest_rad: motion.q,
            posture_rad: motion.q,
            goal: motion.pose,
            target: motion.pose,
            wanted: compliance,
            gains: compliance,
            sum: Vector6::zeros(),
        }
    }

    /// Makes this pose the target. The summed error starts anew if the target has changed.
    pub fn set_target(&mut self, pose: Isometry3<f64>) {
        if pose != self.goal {
            self.goal = pose;
            self.sum = Vector6::zeros();
        }
    }

    /// Makes this pose the target at once, without the low-pass.
    pub fn hold(&mut self, pose: Isometry3<f64>) {
        (self.goal, self.target) = (pose, pose);
        self.sum = Vector6::zeros();
    }

    /// Makes these joint angles the posture. The law approaches them by 0.5 rad/s, so that an elbow far from its posture is not jerked.
    pub fn set_posture(&mut self, joints_rad: Joints) {
        self.posture_rad = joints_rad;
    }

    /// Makes these the gains.
    pub fn set_compliance(&mut self, compliance: Compliance) {
        self.wanted = compliance;
    }

    /// Returns the clipped error of the pose: translation in m, rotation as the sine of half the angle.
    #[must_use]
    pub fn error(&self, pose: &Isometry3<f64>) -> Vector6<f64> {
        let clip = self.gains.error_clip_m;
        let shift = pose.translation.vector - self.target.translation.vector;
        let turned = pose.rotation.inverse() * self.target.rotation;
        // The quaternion with the positive scalar part is the shorter way round.
        let sign = if turned.w < 0.0 { -1.0 } else { 1.0 };
        let turn = -(pose.rotation * (Vector3::new(turned.i, turned.j, turned.k) * sign));
        let t = shift.map(|v| v.clamp(-clip, clip));
        let r = turn.map(|v| v.clamp(-ROTATION_CLIP, ROTATION_CLIP));
        Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z)
    }

    /// Returns the torques of one cycle, N m, without gravity and friction, and moves the filtered target on.
    pub fn torques(&mut self, motion: &ArmMotion) -> Joints {
        let error = self.error(&motion.pose);
        let limits = Vector6::from_fn(|i, _| MAX_SUM[i / 3]);
        self.sum = (self.sum + error).zip_map(&limits, |v, limit| v.clamp(-limit, limit));
        let (k, d) = (Vector6::from(self.gains.stiffness), Vector6::from(self.gains.damping));
        let twist = motion.jacobian * motion.dq;
        let force = -k.component_mul(&error) - d.component_mul(&twist) - self.sum * self.settings.integral;
        let force = self.settings.speed.brake(&force, &twist);
        let torques = motion.jacobian.transpose() * force + self.nullspace(motion) + motion.coriolis;
        self.advance_filters();
        torques
    }

    /// Torques that pull to the posture in force and do not move the end effector.
    fn nullspace(&self, motion: &ArmMotion) -> Joints {
        let kn = self.settings.nullspace_stiffness;
        let mut error = self.rest_rad - motion.q;
        let mut velocity = motion.dq;
        error[0] *= self.settings.joint1_factor;
        velocity[0] *= 2.0 * self.settings.joint1_factor.sqrt();
        // The whole torque is made smaller, and not that of one joint: the rest of it would move the hand.
        let spring = in_nullspace(&motion.jacobian, &(error * kn)).cap_magnitude(MAX_POSTURE_N_M);
        spring - in_nullspace(&motion.jacobian, &(velocity * (2.0 * kn.sqrt())))
    }

    fn advance_filters(&mut self) {
        let blend = |now: f64, wanted: f64| now + FILTER * (wanted - now);
        for i in 0..6 {
            self.gains.stiffness[i] = blend(self.gains.stiffness[i], self.wanted.stiffness[i]);
            self.gains.damping[i] = blend(self.gains.damping[i], self.wanted.damping[i]);
        }
        self.gains.error_clip_m = blend(self.gains.error_clip_m, self.wanted.error_clip_m);
        self.target = self.settings.speed.advance(&self.target, &self.goal, FILTER, CYCLE_S);
        self.rest_rad += (self.posture_rad - self.rest_rad).cap_magnitude(POSTURE_RAD_S * CYCLE_S);
    }
}

/// Returns the posture of a motion that begins: that of the last motion, or the measured joints of an arm that has none or whose elbow was
/// moved since.
#[must_use]
pub fn posture_at_begin(kept: Option<Joints>, motion: &ArmMotion) -> Joints {
    let is_near = |kept: &Joints| in_nullspace(&motion.jacobian, &(kept - motion.q)).norm() <= MAX_KEPT_RAD;
    kept.filter(is_near).unwrap_or(motion.q)
}

/// Part of joint torques or joint angles that does not act on the end effector.
fn in_nullspace(jacobian: &Jacobian, joints: &Joints) -> Joints {
    // pinv(J^T) = (J J^T + d^2 I)^-1 J, the damped pseudo-inverse with the singular values s / (s^2 + d^2).
    let square =
        jacobian * jacobian.transpose() + Matrix6::identity() * (PSEUDO_INVERSE_DAMPING * PSEUDO_INVERSE_DAMPING);
    // The damping makes the square positive definite, so the decomposition fails for NaN alone.
    let Some(square) = square.cholesky() else { return Joints::zeros() };
    joints - jacobian.transpose() * square.solve(&(jacobian * joints))
}

#[cfg(test)]
mod tests;
