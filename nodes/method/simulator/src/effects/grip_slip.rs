//! Slip through the fingers.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `grip_slip_m_s`: slip through the fingers.
pub(super) struct GripSlip;

impl Effect for GripSlip {
    fn about(&self) -> About {
        About {
            name: "grip_slip_m_s",
            title: "grip slip",
            description: "speed at which the object slips out of the fingers under its own weight, in proportion to the pull",
            unit: "m/s",
            hook: Hook::Boundary,
            // Over a task of 8 s the object slips by 1 mm to 8 cm.
            prior: log_uniform(1e-4, 1e-2),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.grip_slip_m_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN};
    use super::GripSlip;
    use crate::beam::GripState;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&GripSlip);
    }

    #[test]
    fn a_hanging_bar_grows_at_the_speed_of_the_slip() {
        let length_m = |m, time_s| {
            let mut beam = fixtures::at_rest(fixtures::beam(&GripSlip, m, 1e6, |b| b.kelvin_voigt_time_s = 0.01), DOWN);
            beam.advance_to(time_s, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
            beam.deformed_length_m()
        };
        // The length that has slipped out adds weight, so that the speed grows with it.
        let (length, speed) = (fixtures::THETA[0], 5e-3);
        let expected = length * ((speed * 2.0 / length).exp() - 1.0);
        fixtures::close(length_m(speed, 2.0) - length_m(0.0, 2.0), expected, 0.01);
    }
}
