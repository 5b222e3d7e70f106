//! Start velocity.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `start_velocity_m_s`: start velocity.
pub(super) struct StartVelocity;

impl Effect for StartVelocity {
    fn about(&self) -> About {
        About {
            name: "start_velocity_m_s",
            title: "start velocity",
            description: "velocity of the tip across the object when the episode starts; at the share s of the length it is s^2 of that",
            unit: "m/s",
            hook: Hook::Boundary,
            // A bar of 0.3 m that swings by 0.1 m once a second reaches 0.6 m/s.
            prior: uniform(-1.0, 1.0),
            range: [-10.0, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.start.velocity_m_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::StartVelocity;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&StartVelocity);
    }

    /// The tip of a hanging bar starts with the velocity of the magnitude, at its place at rest.
    #[test]
    fn the_tip_starts_in_motion() {
        let first = fixtures::start_of(&StartVelocity, 0.1);
        assert!(first.tip_m[0].abs() < 1e-9, "{first:?}");
        fixtures::close(first.tip_speed_m_s, 0.1, 1e-2);
    }
}
