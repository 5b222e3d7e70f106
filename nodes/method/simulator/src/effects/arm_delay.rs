//! Delay of the arm.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `arm_delay_s`: delay of the arm.
pub(super) struct ArmDelay;

impl Effect for ArmDelay {
    fn about(&self) -> About {
        About {
            name: "arm_delay_s",
            title: "arm delay",
            description: "time that passes before the arm begins to follow a target",
            unit: "s",
            hook: Hook::Actuation,
            // From the period of the cell's measurements to more than half a step of the shipped task (0.5 s).
            prior: log_uniform(5e-3, 0.3),
            range: [0.0, 5.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.arm.delay_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::ArmDelay;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&ArmDelay);
    }

    #[test]
    fn the_arm_does_the_same_later() {
        let at = |m, time_s| {
            let mut arm = ArmModel::new(&fixtures::episode_model(&ArmDelay, m).arm, [0.4, 0.4]);
            arm.set_target(0.0, [0.46, 0.4]);
            arm.run_to(time_s);
            arm.position_m(time_s)[0]
        };
        assert_eq!(at(0.12, 0.12), 0.4);
        fixtures::close(at(0.12, 0.42), at(0.0, 0.3), 1e-9);
    }
}
