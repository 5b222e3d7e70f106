//! Stiffness that changes with time.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::signed;
use crate::beam::AgeingTerm;
use std::sync::Arc;

/// Rate in 1/s.
struct Stiffening(f64);

impl AgeingTerm for Stiffening {
    fn stiffness_factor(&self, time_s: f64) -> f64 {
        (self.0 * time_s).exp()
    }
}

/// Template `template_stiffness_drift_per_s`: all stiffnesses change by the factor exp(m t).
pub fn effect() -> TermEffect {
    TermEffect::new(
        // Five times the stiffness, or a fifth of it, after a task of 8 s.
        signed(
            [
                "template_stiffness_drift_per_s",
                "drift of the stiffness",
                "rate at which the stiffness grows, relative to its value",
                "1/s",
            ],
            Hook::Material,
            [0.2, 1.0],
        ),
        &[],
        |magnitude, episode| episode.terms.ageings.push(Arc::new(Stiffening(magnitude))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN, THETA};
    use crate::beam::GripState;

    #[test]
    fn a_hanging_bar_stretches_less_as_it_stiffens() {
        let rate_per_s = 0.3;
        let mut model = fixtures::template(&super::effect(), rate_per_s, [0.5, 1.0], 5e4);
        // A little damping, so that the bar does not swing about the slow change.
        model.beam.kelvin_voigt_time_s = 0.01;
        let mut beam = fixtures::held(&model, 20, DOWN);
        let first_m = beam.deformed_length_m() - THETA[0];
        for time_s in [1.0, 3.0] {
            beam.advance_to(time_s, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
            let expected_m = first_m * (-rate_per_s * time_s).exp();
            fixtures::close(beam.deformed_length_m() - THETA[0], expected_m, 0.01);
        }
        // A new start is as stiff as the first.
        assert!(beam.hang_at_rest(GripState { tangent_rad: DOWN, ..GripState::default() }).converged);
        fixtures::close(beam.deformed_length_m() - THETA[0], first_m, 1e-9);
    }
}
