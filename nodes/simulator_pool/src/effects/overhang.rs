//! An overhang behind the grip.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// An overhang behind the grip.
pub(super) struct Overhang;

impl Effect for Overhang {
    fn about(&self) -> About {
        About {
            name: "overhang_m",
            title: "overhang",
            description: "length of the object that sticks out behind the grip and is missing before it",
            unit: "m",
            hook: Hook::Boundary,
            prior: log_uniform(1e-3, 0.03),
            range: [0.0, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.overhang_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, DOWN, THETA};
    use super::Overhang;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&Overhang);
    }

    #[test]
    fn the_part_before_the_grip_is_shorter_and_the_weight_stays() {
        let beam = |m| trial::at_rest(trial::beam(&Overhang, m, 1e7, |_| ()), DOWN);
        let (whole, held_in) = (beam(0.0), beam(0.02));
        trial::close(-held_in.tip()[1], THETA[0] - 0.02, 1e-3);
        trial::close(held_in.grip_reaction().force_z_n, whole.grip_reaction().force_z_n, 1e-6);
    }
}
