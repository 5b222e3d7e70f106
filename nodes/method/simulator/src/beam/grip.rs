//! Grip: state of the clamped section, and the load on it.

use super::node::Node;
use catenary_core::GripPose;

/// State of the clamped section: place and tangent that the gripper prescribes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GripState {
    /// x in m.
    pub x_m: f64,
    /// z in m, up.
    pub z_m: f64,
    /// Angle in rad of the section's normal direction along the beam, towards the tip, counter-clockwise from +x.
    pub tangent_rad: f64,
}

impl GripState {
    /// Converts the hand's pose. `grip_angle_rad` is the tangent at pitch 0; a positive pitch turns it clockwise.
    pub fn from_pose(pose: GripPose, grip_angle_rad: f64) -> Self {
        Self { x_m: pose.x_m, z_m: pose.z_m, tangent_rad: grip_angle_rad - pose.pitch_rad }
    }

    pub(super) fn node(&self) -> Node {
        [self.x_m, self.z_m, self.tangent_rad]
    }
}

/// Reaction of the gripper: force and moment on the beam.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GripReaction {
    /// Force on the beam along x in N.
    pub force_x_n: f64,
    /// Force on the beam along z in N. It equals the beam's weight if the beam hangs at rest.
    pub force_z_n: f64,
    /// Moment on the beam in N m, counter-clockwise.
    pub moment_n_m: f64,
}
