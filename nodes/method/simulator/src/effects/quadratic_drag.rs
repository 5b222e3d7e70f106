//! Quadratic air drag.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `quadratic_drag_n_s2_m3`: quadratic air drag.
pub(super) struct QuadraticDrag;

impl Effect for QuadraticDrag {
    fn about(&self) -> About {
        About {
            name: "quadratic_drag_n_s2_m3",
            title: "quadratic air drag",
            description: "force against the velocity across the centre line, per length and squared speed",
            unit: "N s^2/m^3",
            hook: Hook::Force,
            // A square bar of 15 mm in air has about 0.02 (drag coefficient 2, 1.2 kg/m^3).
            prior: log_uniform(1e-3, 0.5),
            range: [0.0, 1e3],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.quadratic_drag_n_s2_m3 += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, THETA};
    use super::QuadraticDrag;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&QuadraticDrag);
    }

    #[test]
    fn a_stiff_bar_in_steady_motion_is_held_against_the_drag() {
        let (magnitude, speed) = (0.1, 0.5);
        let parameters = fixtures::beam(&QuadraticDrag, magnitude, 2e6, |b| b.kelvin_voigt_time_s = 0.2);
        fixtures::close(fixtures::steady_drag_n(parameters, speed, 5.0), magnitude * speed * speed * THETA[0], 1e-2);
    }
}
