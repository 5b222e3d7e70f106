//! Linear air drag.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Linear air drag.
pub(super) struct LinearDrag;

impl Effect for LinearDrag {
    fn about(&self) -> About {
        About {
            name: "linear_drag_n_s_m2",
            title: "linear air drag",
            description: "force against the velocity, per length and speed",
            unit: "N s/m^2",
            hook: Hook::Force,
            prior: log_uniform(1e-3, 0.5),
            range: [0.0, 1e3],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.linear_drag_n_s_m2 += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, THETA};
    use super::LinearDrag;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&LinearDrag);
    }

    #[test]
    fn a_bar_in_steady_motion_is_held_against_the_drag() {
        let (magnitude, speed) = (0.3, 0.2);
        let parameters = trial::beam(&LinearDrag, magnitude, 1e6, |b| b.kelvin_voigt_time_s = 0.1);
        trial::close(trial::steady_drag_n(parameters, speed, 4.0), magnitude * speed * THETA[0], 1e-3);
    }
}
