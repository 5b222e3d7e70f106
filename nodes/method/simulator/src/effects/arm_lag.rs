//! Lag of the arm.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `arm_lag_s`: lag of the arm.
pub(super) struct ArmLag;

impl Effect for ArmLag {
    fn about(&self) -> About {
        About {
            name: "arm_lag_s",
            title: "arm lag",
            description: "time constant that comes on top of the arm's own",
            unit: "s",
            hook: Hook::Actuation,
            // From 3 % of the shipped arm's time constant (0.16 s) to twice its value.
            prior: log_uniform(5e-3, 0.3),
            range: [0.0, 5.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.arm.extra_lag_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::ArmLag;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&ArmLag);
    }

    /// The shipped bar's arm has a time constant of 0.16 s.
    #[test]
    fn the_time_constants_add_up() {
        let mut arm = ArmModel::new(&fixtures::episode_model(&ArmLag, 0.14).arm, [0.4, 0.4]);
        arm.set_target(0.0, [0.46, 0.4]);
        arm.run_to(0.2);
        fixtures::close(0.46 - arm.position_m(0.2)[0], 0.06 * (-0.2f64 / 0.3).exp(), 1e-9);
    }
}
