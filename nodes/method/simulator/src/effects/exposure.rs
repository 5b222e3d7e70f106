//! Exposure blur.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `exposure_s`: exposure blur.
pub(super) struct Exposure;

impl Effect for Exposure {
    fn about(&self) -> About {
        About {
            name: "exposure_s",
            title: "exposure",
            description: "time over which a frame gathers light: a moving object is seen at its mean place",
            unit: "s",
            hook: Hook::Observation,
            // Up to more than the period of a camera at 30 Hz (33 ms).
            prior: log_uniform(1e-3, 0.05),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.exposure_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::Exposure;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&Exposure);
    }

    /// A mean over the exposure shows a steadily moving point half an exposure late.
    #[test]
    fn frames_show_the_mean_place() {
        fixtures::is_seen_late(&Exposure, 0.04, 0.2, 0.02);
    }
}
