//! Kelvin-Voigt damping.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `kelvin_voigt_time_s`: Kelvin-Voigt damping.
pub(super) struct KelvinVoigt;

impl Effect for KelvinVoigt {
    fn about(&self) -> About {
        About {
            name: "kelvin_voigt_time_s",
            title: "Kelvin-Voigt damping",
            description: "retardation time: larger damps bending and stretching more",
            unit: "s",
            hook: Hook::Material,
            // Holds the ranges of both shipped models.
            prior: log_uniform(1e-3, 1.0),
            range: [0.0, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.kelvin_voigt_time_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN};
    use super::KelvinVoigt;
    use crate::beam::GripState;
    use std::f64::consts::PI;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&KelvinVoigt);
    }

    /// A vibration of angular frequency w loses exp(-pi m w) of its amplitude a cycle: the damping ratio is m w / 2.
    #[test]
    fn a_vibration_dies_at_the_rate_of_the_retardation_time() {
        let retardation_s = 2e-3;
        // Almost without gravity, whose restoring force is not damped.
        let parameters = fixtures::beam(&KelvinVoigt, retardation_s, 2e7, |b| b.gravity_m_s2 = [0.0, -1e-6]);
        let mut beam = fixtures::at_rest(parameters, DOWN);
        let grip = GripState { tangent_rad: DOWN, ..GripState::default() };
        beam.set_velocity([0.05, 0.0]);
        let mut zeros = Vec::new();
        let (mut before, mut peak, mut peaks) = (0.0, 0.0f64, Vec::new());
        for i in 1..1000 {
            let time_s = 2e-3 * f64::from(i);
            beam.advance_to(time_s, |_| grip);
            let x = beam.tip()[0];
            if x * before < 0.0 {
                zeros.push(time_s);
                peaks.push(peak);
                peak = 0.0;
            }
            (before, peak) = (x, peak.max(x.abs()));
        }
        let last = zeros.len() - 1;
        let omega = PI * (last - 2) as f64 / (zeros[last] - zeros[2]);
        let decrement = 2.0 * (peaks[3] / peaks[last]).ln() / (last - 3) as f64;
        fixtures::close(decrement, PI * retardation_s * omega, 0.03);
    }
}
