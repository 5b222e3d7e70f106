//! Density.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Density.
pub(super) struct Density;

impl Effect for Density {
    fn about(&self) -> About {
        About {
            name: "density_change",
            title: "density",
            description: "relative change of the density",
            unit: "1",
            hook: Hook::Material,
            prior: uniform(-0.3, 0.3),
            range: [-0.9, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.mass_per_length_kg_m *= 1.0 + magnitude;
        world.beam.rotary_inertia_per_length_kg_m *= 1.0 + magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, DOWN};
    use super::Density;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&Density);
    }

    #[test]
    fn weight_grows_by_the_share() {
        let weight_n = |m| trial::at_rest(trial::beam(&Density, m, 2e4, |_| ()), DOWN).grip_reaction().force_z_n;
        trial::close(weight_n(0.25), 1.25 * weight_n(0.0), 1e-6);
    }
}
