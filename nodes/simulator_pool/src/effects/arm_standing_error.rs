//! Standing error of the arm.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Standing error of the arm.
pub(super) struct ArmStandingError;

impl Effect for ArmStandingError {
    fn about(&self) -> About {
        About {
            name: "arm_standing_error_m",
            title: "arm standing error",
            description: "distance from the target at which a soft, sticking arm stops",
            unit: "m",
            hook: Hook::Actuation,
            prior: log_uniform(5e-4, 0.02),
            range: [0.0, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.arm.standing_error_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::ArmStandingError;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&ArmStandingError);
    }

    #[test]
    fn the_arm_stops_short_on_the_way_that_it_came() {
        let mut arm = ArmModel::new(&trial::world(&ArmStandingError, 0.01).arm, [0.4, 0.4]);
        arm.set_target(0.0, [0.43, 0.36]);
        arm.run_to(5.0);
        let [x, z] = arm.position_m(5.0);
        trial::close(0.43 - x, 0.01 * 0.6, 1e-6);
        trial::close(z - 0.36, 0.01 * 0.8, 1e-6);
    }
}
