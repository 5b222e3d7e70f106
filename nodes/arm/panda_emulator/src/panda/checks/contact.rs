//! Contact and collision from the estimate of external forces.

use crate::fci::{CollisionThresholds, ErrorKind, Errors};
use crate::panda::chain::{Joints, Six};

/// Flags of contact (lower thresholds) and of collision (upper thresholds), 0 or 1.
#[derive(Debug, Clone, Copy, Default)]
pub struct Contact {
    /// Joints in contact.
    pub joints: [f64; 7],
    /// Axes of K in contact.
    pub axes: [f64; 6],
    /// Joints in collision.
    pub joint_collisions: [f64; 7],
    /// Axes of K in collision.
    pub axis_collisions: [f64; 6],
    /// Collisions stay until a recovery.
    latched: bool,
}

impl Contact {
    /// Updates the flags and returns the reflexes. `accelerating`: the thresholds of acceleration phases hold.
    pub fn update(
        &mut self,
        thresholds: &CollisionThresholds,
        accelerating: bool,
        torques: &Joints,
        wrench_k: &Six,
    ) -> Errors {
        let t = thresholds;
        let (lower_torques, upper_torques, lower_forces, upper_forces) = if accelerating {
            (
                &t.lower_torques_acceleration,
                &t.upper_torques_acceleration,
                &t.lower_forces_acceleration,
                &t.upper_forces_acceleration,
            )
        } else {
            (&t.lower_torques_nominal, &t.upper_torques_nominal, &t.lower_forces_nominal, &t.upper_forces_nominal)
        };
        let flag = |value: f64, threshold: f64| f64::from(u8::from(value.abs() > threshold));
        self.joints = std::array::from_fn(|i| flag(torques[i], lower_torques[i]));
        self.axes = std::array::from_fn(|i| flag(wrench_k[i], lower_forces[i]));
        if self.latched {
            return Errors::default();
        }
        self.joint_collisions = std::array::from_fn(|i| flag(torques[i], upper_torques[i]));
        self.axis_collisions = std::array::from_fn(|i| flag(wrench_k[i], upper_forces[i]));
        let mut errors = Errors::default();
        if self.joint_collisions.contains(&1.0) {
            errors.insert(ErrorKind::JointReflex);
        }
        if self.axis_collisions.contains(&1.0) {
            errors.insert(ErrorKind::CartesianReflex);
        }
        errors
    }

    /// Keeps the collisions until [`Self::release`].
    pub fn latch(&mut self) {
        self.latched = true;
    }

    /// Forgets the collisions after a recovery.
    pub fn release(&mut self) {
        self.latched = false;
    }
}
