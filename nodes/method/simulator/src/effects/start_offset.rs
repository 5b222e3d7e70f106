//! Start offset.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `start_offset_m`: start offset.
pub(super) struct StartOffset;

impl Effect for StartOffset {
    fn about(&self) -> About {
        About {
            name: "start_offset_m",
            title: "start offset",
            description: "displacement of the tip across the object when the episode starts; at the share s of the length it is s^2 of that",
            unit: "m",
            hook: Hook::Boundary,
            // A third of a bar of 0.3 m, at most.
            prior: uniform(-0.1, 0.1),
            range: [-1.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.start.offset_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::StartOffset;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&StartOffset);
    }

    /// The tip is displaced across a hanging bar by the magnitude, and the bar swings back.
    #[test]
    fn the_tip_starts_aside() {
        let first = fixtures::start_of(&StartOffset, 0.01);
        fixtures::close(first.tip_m[0], 0.01, 1e-2);
        fixtures::close(first.middle_m[0], 0.0025, 5e-2);
        assert!(first.tip_speed_m_s.abs() < 1e-4, "{first:?}");
    }
}
