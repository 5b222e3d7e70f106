//! A set-up that is not level.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `gravity_tilt_rad`: a set-up that is not level.
pub(super) struct GravityTilt;

impl Effect for GravityTilt {
    fn about(&self) -> About {
        About {
            name: "gravity_tilt_rad",
            title: "gravity tilt",
            description: "turn of gravity, counter-clockwise, if the whole set-up stands askew",
            unit: "rad",
            hook: Hook::Force,
            prior: uniform(-0.1, 0.1),
            range: [-0.5, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        // Skipped at zero, so that no rounding changes a bit.
        if magnitude != 0.0 {
            let (sin, cos) = magnitude.sin_cos();
            let [x, z] = episode.beam.gravity_m_s2;
            episode.beam.gravity_m_s2 = [cos * x - sin * z, sin * x + cos * z];
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN};
    use super::GravityTilt;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&GravityTilt);
    }

    #[test]
    fn gravity_turns_by_the_tilt() {
        let held = |m| fixtures::at_rest(fixtures::beam(&GravityTilt, m, 2e4, |_| ()), DOWN).grip_reaction();
        let weight_n = held(0.0).force_z_n;
        let tilted = held(0.1);
        fixtures::close(-tilted.force_x_n, weight_n * 0.1f64.sin(), 1e-6);
        fixtures::close(tilted.force_z_n, weight_n * 0.1f64.cos(), 1e-6);
    }
}
