//! A held section whose angle swings with time.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::wave::{Phase, Wave};
use super::{FREQUENCY, signed};
use crate::beam::{GripReaction, GripState, GripTerm};
use std::sync::Arc;

/// Angle in rad.
struct Turn(Wave);

impl GripTerm for Turn {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        grip.tangent_rad += self.0.at(time_s);
    }
}

/// Templates `template_harmonic_grip_sin_rad` and `template_harmonic_grip_cos_rad`: a harmonic angle of the held section.
pub fn effect(phase: Phase) -> TermEffect {
    let [name, title, description] = match phase {
        Phase::Sine => [
            "template_harmonic_grip_sin_rad",
            "harmonic angle of the grip, sine",
            "angle of the held section at template_frequency_hz, zero at the start",
        ],
        Phase::Cosine => [
            "template_harmonic_grip_cos_rad",
            "harmonic angle of the grip, cosine",
            "angle of the held section at template_frequency_hz, largest at the start",
        ],
    };
    TermEffect::new(
        signed([name, title, description, "rad"], Hook::Boundary, [0.3, 1.5]),
        &[FREQUENCY],
        move |magnitude, episode| {
            let wave = Wave::new(magnitude, &episode.templates, phase);
            episode.terms.grips.push(Arc::new(Turn(wave)));
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN};
    use super::Phase;
    use crate::beam::GripState;
    use std::f64::consts::TAU;

    #[test]
    fn the_held_section_follows_the_wave_from_the_start_on() {
        let (magnitude, frequency_hz) = (0.2, 1.3);
        for phase in [Phase::Sine, Phase::Cosine] {
            let model = fixtures::template(&super::effect(phase), magnitude, [0.5, frequency_hz], 2e4);
            let mut beam = fixtures::held(&model, 20, DOWN);
            for time_s in [0.0, 0.1, 0.7] {
                beam.advance_to(time_s, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
                let wave = phase.at(TAU * frequency_hz * time_s);
                let turned = beam.nodes()[0][2] - DOWN;
                assert!((turned - magnitude * wave).abs() < 1e-9, "{phase:?} {time_s}: {turned}");
            }
        }
    }
}
