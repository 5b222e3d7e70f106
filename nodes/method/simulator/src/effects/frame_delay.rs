//! Delay of the frames.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `frame_delay_s`: delay of the frames.
pub(super) struct FrameDelay;

impl Effect for FrameDelay {
    fn about(&self) -> About {
        About {
            name: "frame_delay_s",
            title: "frame delay",
            description: "age of a frame's content at its stamp",
            unit: "s",
            hook: Hook::Observation,
            // Up to nine frames of a camera at 30 Hz.
            prior: log_uniform(5e-3, 0.3),
            range: [0.0, 2.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.frame_delay_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::FrameDelay;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&FrameDelay);
    }

    /// In steady motion a frame shows the bar as far back as it moves within the delay.
    #[test]
    fn frames_show_the_past() {
        let u =
            |m| fixtures::episode(&[("frame_delay_s", m), ("keypoint_noise_px", 0.0)], fixtures::gliding(0.02)).frames;
        let (now, late) = (u(0.0), u(0.2));
        let per_second = (now[22].dlo[1][0] - now[20].dlo[1][0]) / 0.2;
        let behind = now[22].dlo[1][0] - late[22].dlo[1][0];
        // Both tracks have equal noise, so that it cancels in the difference of the two frames.
        assert!((late[22].dlo[1][0] - now[20].dlo[1][0]).abs() < 0.03, "{behind} against {}", 0.2 * per_second);
        assert_ne!(now[22].dlo, late[22].dlo);
    }
}
