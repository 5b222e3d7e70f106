//! Slip through the fingers.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Slip through the fingers.
pub(super) struct GripSlip;

impl Effect for GripSlip {
    fn about(&self) -> About {
        About {
            name: "grip_slip_m_s",
            title: "grip slip",
            description: "speed at which the object slips out of the fingers under its own weight, in proportion to the pull",
            unit: "m/s",
            hook: Hook::Boundary,
            prior: log_uniform(1e-4, 1e-2),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.grip_slip_m_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, DOWN};
    use super::GripSlip;
    use crate::beam::GripState;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&GripSlip);
    }

    #[test]
    fn a_hanging_bar_grows_at_the_speed_of_the_slip() {
        let length_m = |m, time_s| {
            let mut beam = trial::at_rest(trial::beam(&GripSlip, m, 1e6, |b| b.kelvin_voigt_time_s = 0.01), DOWN);
            beam.advance_to(time_s, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
            beam.deformed_length_m()
        };
        // What has slipped out is weight, too: the speed grows with it.
        let (length, speed) = (trial::THETA[0], 5e-3);
        let expected = length * ((speed * 2.0 / length).exp() - 1.0);
        trial::close(length_m(speed, 2.0) - length_m(0.0, 2.0), expected, 0.01);
    }
}
