//! An object held askew.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// An object held askew.
pub(super) struct GripAngle;

impl Effect for GripAngle {
    fn about(&self) -> About {
        About {
            name: "grip_angle_offset_rad",
            title: "grip angle",
            description: "angle by which the object is held askew, counter-clockwise",
            unit: "rad",
            hook: Hook::Boundary,
            prior: uniform(-0.3, 0.3),
            range: [-1.6, 1.6],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.grip_angle_rad += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::GripAngle;
    use crate::beam::GripState;
    use catenary_core::GripPose;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&GripAngle);
    }

    #[test]
    fn the_held_section_is_turned() {
        let world = trial::world(&GripAngle, 0.2);
        let grip = GripState::from_pose(GripPose::default(), world.grip_angle_rad);
        trial::close(trial::at_rest(world.beam, grip.tangent_rad).nodes()[0][2], 0.2, 1e-12);
    }
}
