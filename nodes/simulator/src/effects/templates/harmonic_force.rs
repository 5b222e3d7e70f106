//! A force along x that swings with time.

use super::super::effect::{About, Effect, Hook};
use super::wave::{Phase, Wave};
use super::{FREQUENCY, signed};
use crate::beam::{ForceTerm, PointState};
use crate::episode_model::EpisodeModel;
use std::sync::Arc;

/// Templates `template_harmonic_force_sin_n_m` and `template_harmonic_force_cos_n_m`: a harmonic force along x.
pub struct HarmonicForce(pub Phase);

/// Force in N/m.
struct Push(Wave);

impl ForceTerm for Push {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        [self.0.at(at.time_s) * at.length_m, 0.0]
    }
}

impl Effect for HarmonicForce {
    fn about(&self) -> About {
        let (name, title, description) = match self.0 {
            Phase::Sine => (
                "template_harmonic_force_sin_n_m",
                "harmonic force, sine",
                "force per length along x at template_frequency_hz, zero at the start",
            ),
            Phase::Cosine => (
                "template_harmonic_force_cos_n_m",
                "harmonic force, cosine",
                "force per length along x at template_frequency_hz, largest at the start",
            ),
        };
        // A soft bar weighs 2.3 N/m.
        signed(name, title, description, "N/m", Hook::Force, [2.0, 100.0])
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.terms.forces.push(Arc::new(Push(Wave::new(magnitude, &episode.templates, self.0))));
        Ok(())
    }

    fn companions(&self) -> &'static [&'static str] {
        &[FREQUENCY]
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN, THETA};
    use super::{HarmonicForce, Phase};
    use crate::beam::GripState;
    use std::f64::consts::TAU;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::template_at_zero_is_the_base(&HarmonicForce(Phase::Sine));
        fixtures::template_at_zero_is_the_base(&HarmonicForce(Phase::Cosine));
    }

    /// A slow force on a damped bar: the grip holds against it.
    #[test]
    fn the_grip_holds_against_the_force_of_each_phase() {
        let (magnitude, frequency_hz) = (0.1, 0.05);
        for phase in [Phase::Sine, Phase::Cosine] {
            let mut model = fixtures::template(&HarmonicForce(phase), magnitude, [0.5, frequency_hz], 1e6);
            model.beam.kelvin_voigt_time_s = 0.05;
            let mut beam = fixtures::held(&model, 20, DOWN);
            for time_s in [3.0, 8.0] {
                beam.advance_to(time_s, |_| GripState { tangent_rad: DOWN, ..GripState::default() });
                let angle = TAU * frequency_hz * time_s;
                let wave = if phase == Phase::Sine { angle.sin() } else { angle.cos() };
                fixtures::close(-beam.grip_reaction().force_x_n, magnitude * THETA[0] * wave, 0.01);
            }
        }
    }
}
