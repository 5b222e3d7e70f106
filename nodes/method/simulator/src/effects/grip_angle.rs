//! An object held askew.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `grip_angle_offset_rad`: an object held askew.
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
            // A quarter turn to either side.
            range: [-1.6, 1.6],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.grip_angle_rad += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::GripAngle;
    use crate::beam::GripState;
    use catenary_core::GripPose;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&GripAngle);
    }

    #[test]
    fn the_held_section_is_turned() {
        let episode = fixtures::episode_model(&GripAngle, 0.2);
        let grip = GripState::from_pose(GripPose::default(), episode.grip_angle_rad);
        fixtures::close(fixtures::at_rest(episode.beam, grip.tangent_rad).nodes()[0][2], 0.2, 1e-12);
    }
}
