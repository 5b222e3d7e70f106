//! Delay of the arm.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Delay of the arm.
pub(super) struct ArmDelay;

impl Effect for ArmDelay {
    fn about(&self) -> About {
        About {
            name: "arm_delay_s",
            title: "arm delay",
            description: "time that passes before the arm begins to follow a target",
            unit: "s",
            hook: Hook::Actuation,
            prior: log_uniform(5e-3, 0.3),
            range: [0.0, 5.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.arm.delay_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::ArmDelay;
    use crate::arm::ArmModel;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&ArmDelay);
    }

    #[test]
    fn the_arm_does_the_same_later() {
        let at = |m, time_s| {
            let mut arm = ArmModel::new(&trial::world(&ArmDelay, m).arm, [0.4, 0.4]);
            arm.set_target(0.0, [0.46, 0.4]);
            arm.run_to(time_s);
            arm.position_m(time_s)[0]
        };
        assert_eq!(at(0.12, 0.12), 0.4);
        trial::close(at(0.12, 0.42), at(0.0, 0.3), 1e-9);
    }
}
