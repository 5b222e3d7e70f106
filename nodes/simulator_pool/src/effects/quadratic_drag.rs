//! Quadratic air drag.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Quadratic air drag.
pub(super) struct QuadraticDrag;

impl Effect for QuadraticDrag {
    fn about(&self) -> About {
        About {
            name: "quadratic_drag_n_s2_m3",
            title: "quadratic air drag",
            description: "force against the velocity across the centre line, per length and squared speed",
            unit: "N s^2/m^3",
            hook: Hook::Force,
            prior: log_uniform(1e-3, 0.5),
            range: [0.0, 1e3],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.quadratic_drag_n_s2_m3 += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, THETA};
    use super::QuadraticDrag;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&QuadraticDrag);
    }

    #[test]
    fn a_stiff_bar_in_steady_motion_is_held_against_the_drag() {
        let (magnitude, speed) = (0.1, 0.5);
        let parameters = trial::beam(&QuadraticDrag, magnitude, 2e6, |b| b.kelvin_voigt_time_s = 0.2);
        trial::close(trial::steady_drag_n(parameters, speed, 5.0), magnitude * speed * speed * THETA[0], 1e-2);
    }
}
