//! Dropped frames.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `dropped_frames`: dropped frames.
pub(super) struct DroppedFrames;

impl Effect for DroppedFrames {
    fn about(&self) -> About {
        About {
            name: "dropped_frames",
            title: "dropped frames",
            description: "share of frames that repeat the one before",
            unit: "1",
            hook: Hook::Observation,
            // From one frame in a hundred to every second one.
            prior: log_uniform(0.01, 0.5),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.dropped_share += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::DroppedFrames;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&DroppedFrames);
    }

    #[test]
    fn dropped_frames_repeat_the_first() {
        let frames = fixtures::episode(&[("dropped_frames", 1.0)], fixtures::gliding(0.02)).frames;
        assert!(frames.iter().all(|f| f.dlo == frames[0].dlo));
    }
}
