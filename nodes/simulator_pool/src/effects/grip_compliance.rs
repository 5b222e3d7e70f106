//! Soft fingers.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Soft fingers.
pub(super) struct GripCompliance;

impl Effect for GripCompliance {
    fn about(&self) -> About {
        About {
            name: "grip_compliance_rad_n_m",
            title: "grip compliance",
            description: "turn of the held end per moment: how soft the fingers are",
            unit: "rad/(N m)",
            hook: Hook::Boundary,
            prior: log_uniform(0.1, 100.0),
            range: [0.0, 1e4],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.grip_compliance_rad_n_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::GripCompliance;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&GripCompliance);
    }

    #[test]
    fn the_held_section_turns_in_proportion_to_its_moment() {
        let magnitude = 2.0;
        let beam = trial::at_rest(trial::beam(&GripCompliance, magnitude, 1e6, |_| ()), 0.0);
        let (turn_rad, moment_n_m) = (beam.nodes()[0][2], beam.grip_reaction().moment_n_m);
        assert!(turn_rad < -0.05, "it sags: {turn_rad} rad");
        trial::close(turn_rad, -magnitude * moment_n_m, 1e-5);
    }
}
