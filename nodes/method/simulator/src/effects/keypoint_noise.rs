//! Noise of the keypoints.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `keypoint_noise_px`: noise of the keypoints.
pub(super) struct KeypointNoise;

impl Effect for KeypointNoise {
    fn about(&self) -> About {
        About {
            name: "keypoint_noise_px",
            title: "keypoint noise",
            description: "standard deviation of noise on top of the model's, in mask pixels",
            unit: "px",
            hook: Hook::Observation,
            prior: log_uniform(0.1, 5.0),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        // Independent noises add by their variances.
        episode.camera.keypoint_noise_px = episode.camera.keypoint_noise_px.hypot(magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::KeypointNoise;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&KeypointNoise);
    }

    /// The shipped bar's model has 0.7 px of its own.
    #[test]
    fn variances_add_up() {
        fixtures::close(fixtures::episode_model(&KeypointNoise, 2.4).camera.keypoint_noise_px, 2.5, 1e-12);
    }
}
