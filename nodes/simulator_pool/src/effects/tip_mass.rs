//! A mass at the tip.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// A mass at the tip.
pub(super) struct TipMass;

impl Effect for TipMass {
    fn about(&self) -> About {
        About {
            name: "tip_mass_kg",
            title: "tip mass",
            description: "point mass at the tip",
            unit: "kg",
            hook: Hook::Force,
            prior: log_uniform(1e-4, 0.5),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.tip_mass_kg += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, DOWN, GRAVITY};
    use super::TipMass;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&TipMass);
    }

    #[test]
    fn the_grip_carries_its_weight() {
        let weight_n = |m| trial::at_rest(trial::beam(&TipMass, m, 2e4, |_| ()), DOWN).grip_reaction().force_z_n;
        trial::close(weight_n(0.02) - weight_n(0.0), 0.02 * GRAVITY, 1e-6);
    }
}
