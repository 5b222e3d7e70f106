//! Linear air drag.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `linear_drag_n_s_m2`: linear air drag.
pub(super) struct LinearDrag;

impl Effect for LinearDrag {
    fn about(&self) -> About {
        About {
            name: "linear_drag_n_s_m2",
            title: "linear air drag",
            description: "force against the velocity, per length and speed",
            unit: "N s/m^2",
            hook: Hook::Force,
            // The velocity of a soft bar (0.24 kg/m) decays with a time constant of 240 s to 0.5 s.
            prior: log_uniform(1e-3, 0.5),
            range: [0.0, 1e3],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.linear_drag_n_s_m2 += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, THETA};
    use super::LinearDrag;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&LinearDrag);
    }

    #[test]
    fn grip_force_of_a_bar_in_steady_motion_equals_the_drag() {
        let (magnitude, speed) = (0.3, 0.2);
        let parameters = fixtures::beam(&LinearDrag, magnitude, 1e6, |b| b.kelvin_voigt_time_s = 0.1);
        fixtures::close(fixtures::steady_drag_n(parameters, speed, 4.0), magnitude * speed * THETA[0], 1e-3);
    }
}
