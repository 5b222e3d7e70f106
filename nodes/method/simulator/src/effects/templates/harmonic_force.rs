//! A force along x that swings with time.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::wave::{Phase, Wave};
use super::{FREQUENCY, signed};
use crate::beam::{ForceTerm, PointState};
use std::sync::Arc;

/// Force in N/m.
struct Push(Wave);

impl ForceTerm for Push {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        [self.0.at(at.time_s) * at.length_m, 0.0]
    }
}

/// Templates `template_harmonic_force_sin_n_m` and `template_harmonic_force_cos_n_m`: a harmonic force along x.
pub fn effect(phase: Phase) -> TermEffect {
    let [name, title, description] = match phase {
        Phase::Sine => [
            "template_harmonic_force_sin_n_m",
            "harmonic force, sine",
            "force per length along x at template_frequency_hz, zero at the start",
        ],
        Phase::Cosine => [
            "template_harmonic_force_cos_n_m",
            "harmonic force, cosine",
            "force per length along x at template_frequency_hz, largest at the start",
        ],
    };
    TermEffect::new(
        // A soft bar weighs 2.3 N/m.
        signed([name, title, description, "N/m"], Hook::Force, [2.0, 100.0]),
        &[FREQUENCY],
        move |magnitude, episode| {
            let wave = Wave::new(magnitude, &episode.templates, phase);
            episode.terms.forces.push(Arc::new(Push(wave)));
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN, THETA};
    use super::Phase;
    use crate::beam::GripState;
    use std::f64::consts::TAU;

    /// A slow force on a damped bar: the grip holds against it.
    #[test]
    fn the_grip_holds_against_the_force_of_each_phase() {
        let (magnitude, frequency_hz) = (0.1, 0.05);
        for phase in [Phase::Sine, Phase::Cosine] {
            let mut model = fixtures::template(&super::effect(phase), magnitude, [0.5, frequency_hz], 1e6);
            model.beam.kelvin_voigt_time_s = 0.05;
            let mut beam = fixtures::held(&model, 20, DOWN);
            for time_s in [3.0, 8.0] {
                beam.advance_to(time_s, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
                let wave = phase.at(TAU * frequency_hz * time_s);
                fixtures::close(-beam.grip_reaction().force_x_n, magnitude * THETA[0] * wave, 0.01);
            }
        }
    }
}
