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

mod barriers;

pub use barriers::{Barriers, JointLimits};

use crate::compliance::Compliance;
use crate::kinematics::JOINTS;
use nalgebra::{Isometry3, Matrix6, SMatrix, SVector, Translation3, UnitQuaternion, Vector3, Vector6};

/// Vector of joint values.
pub type Joints = SVector<f64, JOINTS>;
/// Jacobian of the end effector in the base frame: linear rows, then angular rows.
pub type Jacobian = SMatrix<f64, 6, JOINTS>;

/// Share of a new target and of new gains that a cycle of 1 ms takes over (SERL's `filter_params`).
const FILTER: f64 = 0.005;
/// Damping of the pseudo-inverse (SERL).
const PSEUDO_INVERSE_DAMPING: f64 = 0.2;
/// Limits of the summed error: translation in m, rotation as the sine of half the angle (SERL).
const MAX_SUM: [f64; 2] = [0.1, 0.3];
/// Limit of the rotation error: the sine of half the angle, so that 0.05 is 0.1 rad (SERL).
const ROTATION_CLIP: f64 = 0.05;

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
    /// Stiffness of the null space, N m/rad. A larger one keeps the elbow nearer to its rest posture.
    pub nullspace_stiffness: f64,
    /// Factor of the null-space stiffness of joint 1.
    pub joint1_factor: f64,
}

impl Default for LawSettings {
    fn default() -> Self {
        // The defaults of SERL's controller.
        Self { integral: 0.0, nullspace_stiffness: 0.2, joint1_factor: 100.0 }
    }
}

/// Impedance law with its filtered target and gains.
#[derive(Debug, Clone)]
pub struct ImpedanceLaw {
    settings: LawSettings,
    /// Posture that the null space pulls to, rad.
    rest_rad: Joints,
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
        let torques = motion.jacobian.transpose() * force + self.nullspace(motion) + motion.coriolis;
        self.advance_filters();
        torques
    }

    /// Torques that pull to the rest posture and move the end effector little.
    fn nullspace(&self, motion: &ArmMotion) -> Joints {
        let kn = self.settings.nullspace_stiffness;
        let mut error = self.rest_rad - motion.q;
        let mut velocity = motion.dq;
        error[0] *= self.settings.joint1_factor;
        velocity[0] *= 2.0 * self.settings.joint1_factor.sqrt();
        let posture = error * kn - velocity * (2.0 * kn.sqrt());
        // pinv(J^T) = (J J^T + d^2 I)^-1 J, the damped pseudo-inverse that SERL takes from the singular values s / (s^2 + d^2).
        let square = motion.jacobian * motion.jacobian.transpose()
            + Matrix6::identity() * (PSEUDO_INVERSE_DAMPING * PSEUDO_INVERSE_DAMPING);
        // The damping makes the square positive definite, so the decomposition fails for NaN alone.
        let Some(square) = square.cholesky() else { return Joints::zeros() };
        posture - motion.jacobian.transpose() * square.solve(&(motion.jacobian * posture))
    }

    fn advance_filters(&mut self) {
        let blend = |now: f64, wanted: f64| now + FILTER * (wanted - now);
        for i in 0..6 {
            self.gains.stiffness[i] = blend(self.gains.stiffness[i], self.wanted.stiffness[i]);
            self.gains.damping[i] = blend(self.gains.damping[i], self.wanted.damping[i]);
        }
        self.gains.error_clip_m = blend(self.gains.error_clip_m, self.wanted.error_clip_m);
        let translation = self.target.translation.vector.lerp(&self.goal.translation.vector, FILTER);
        // A slerp of orientations half a turn apart has no shortest way: the orientation then stays.
        let rotation: UnitQuaternion<f64> =
            self.target.rotation.try_slerp(&self.goal.rotation, FILTER, 1e-9).unwrap_or(self.target.rotation);
        self.target = Isometry3::from_parts(Translation3::from(translation), rotation);
    }
}

#[cfg(test)]
mod tests;
