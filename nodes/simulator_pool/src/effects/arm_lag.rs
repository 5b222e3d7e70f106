//! Lag of the arm.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Lag of the arm.
pub(super) struct ArmLag;

impl Effect for ArmLag {
    fn about(&self) -> About {
        About {
            name: "arm_lag_s",
            title: "arm lag",
            description: "time constant that comes on top of the arm's own",
            unit: "s",
            hook: Hook::Actuation,
            prior: log_uniform(5e-3, 0.3),
            range: [0.0, 5.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.arm.extra_lag_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::ArmLag;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&ArmLag);
    }

    /// The shipped bar's arm has a time constant of 0.16 s.
    #[test]
    fn the_time_constants_add_up() {
        let mut arm = ArmModel::new(&trial::world(&ArmLag, 0.14).arm, [0.4, 0.4]);
        arm.set_target(0.0, [0.46, 0.4]);
        arm.run_to(0.2);
        trial::close(0.46 - arm.position_m(0.2)[0], 0.06 * (-0.2f64 / 0.3).exp(), 1e-9);
    }
}
