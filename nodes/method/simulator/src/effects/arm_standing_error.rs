//! Standing error of the arm.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `arm_standing_error_m`: standing error of the arm.
pub(super) struct ArmStandingError;

impl Effect for ArmStandingError {
    fn about(&self) -> About {
        About {
            name: "arm_standing_error_m",
            title: "arm standing error",
            description: "distance from the target at which a soft, sticking arm stops",
            unit: "m",
            hook: Hook::Actuation,
            // From a fifth of the keypoints' noise (0.7 px are 2.5 mm) to a third of a step of 6 cm.
            prior: log_uniform(5e-4, 0.02),
            range: [0.0, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.arm.standing_error_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::ArmStandingError;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&ArmStandingError);
    }

    #[test]
    fn the_arm_stops_short_on_the_way_that_it_came() {
        let mut arm = ArmModel::new(&fixtures::episode_model(&ArmStandingError, 0.01).arm, [0.4, 0.4]);
        arm.set_target(0.0, [0.43, 0.36]);
        arm.run_to(5.0);
        let [x, z] = arm.position_m(5.0);
        fixtures::close(0.43 - x, 0.01 * 0.6, 1e-6);
        fixtures::close(z - 0.36, 0.01 * 0.8, 1e-6);
    }
}
