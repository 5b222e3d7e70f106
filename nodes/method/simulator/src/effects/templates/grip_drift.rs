//! A held section that turns steadily.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::signed;
use crate::beam::{GripReaction, GripState, GripTerm};
use std::sync::Arc;

/// Rate in rad/s.
struct Turning(f64);

impl GripTerm for Turning {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        grip.tangent_rad += self.0 * time_s;
    }
}

/// Template `template_grip_drift_rad_s`: the held section turns steadily.
pub fn effect() -> TermEffect {
    TermEffect::new(
        // Half a radian over a task of 8 s.
        signed(
            [
                "template_grip_drift_rad_s",
                "drift of the grip's angle",
                "rate at which the held section turns, counter-clockwise",
                "rad/s",
            ],
            Hook::Boundary,
            [0.06, 1.0],
        ),
        &[],
        |magnitude, episode| episode.terms.grips.push(Arc::new(Turning(magnitude))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN};
    use crate::beam::GripState;

    #[test]
    fn the_held_section_turns_at_the_rate() {
        let mut beam = fixtures::held(&fixtures::template(&super::effect(), 0.05, [0.5, 1.0], 2e4), 20, DOWN);
        beam.advance_to(2.0, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
        fixtures::close(beam.nodes()[0][2] - DOWN, 0.1, 1e-9);
    }
}
