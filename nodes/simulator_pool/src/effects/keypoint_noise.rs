//! Noise of the keypoints.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Noise of the keypoints.
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

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.keypoint_noise_px = world.view.keypoint_noise_px.hypot(magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::KeypointNoise;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&KeypointNoise);
    }

    /// The shipped bar's model has 0.7 px of its own.
    #[test]
    fn variances_add_up() {
        trial::close(trial::world(&KeypointNoise, 2.4).view.keypoint_noise_px, 2.5, 1e-12);
    }
}
