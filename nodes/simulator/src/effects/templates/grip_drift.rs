//! A held section that turns steadily.

use super::super::effect::{About, Effect, Hook};
use super::signed;
use crate::beam::{GripReaction, GripState, GripTerm};
use crate::episode_model::EpisodeModel;
use std::sync::Arc;

/// Template `template_grip_drift_rad_s`: the held section turns steadily.
pub struct GripDrift;

/// Rate in rad/s.
struct Turning(f64);

impl GripTerm for Turning {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        grip.tangent_rad += self.0 * time_s;
    }
}

impl Effect for GripDrift {
    fn about(&self) -> About {
        signed(
            "template_grip_drift_rad_s",
            "drift of the grip's angle",
            "rate at which the held section turns, counter-clockwise",
            "rad/s",
            Hook::Boundary,
            // Half a radian over a task of 8 s.
            [0.06, 1.0],
        )
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.terms.grips.push(Arc::new(Turning(magnitude)));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN};
    use super::GripDrift;
    use crate::beam::GripState;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::template_at_zero_is_the_base(&GripDrift);
    }

    #[test]
    fn the_held_section_turns_at_the_rate() {
        let mut beam = fixtures::held(&fixtures::template(&GripDrift, 0.05, [0.5, 1.0], 2e4), 20, DOWN);
        beam.advance_to(2.0, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
        fixtures::close(beam.nodes()[0][2] - DOWN, 0.1, 1e-9);
    }
}
