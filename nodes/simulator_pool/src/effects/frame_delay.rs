//! Delay of the frames.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Delay of the frames.
pub(super) struct FrameDelay;

impl Effect for FrameDelay {
    fn about(&self) -> About {
        About {
            name: "frame_delay_s",
            title: "frame delay",
            description: "age of what a frame shows at its stamp",
            unit: "s",
            hook: Hook::Observation,
            prior: log_uniform(5e-3, 0.3),
            range: [0.0, 2.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.frame_delay_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::FrameDelay;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&FrameDelay);
    }

    /// In steady motion a frame shows the bar as far back as it moves within the delay.
    #[test]
    fn frames_show_what_was() {
        let u = |m| trial::episode(&[("frame_delay_s", m), ("keypoint_noise_px", 0.0)], trial::gliding(0.02)).frames;
        let (now, late) = (u(0.0), u(0.2));
        let per_second = (now[22].dlo[1][0] - now[20].dlo[1][0]) / 0.2;
        let behind = now[22].dlo[1][0] - late[22].dlo[1][0];
        // The noise of both tracks is the same draw.
        assert!((late[22].dlo[1][0] - now[20].dlo[1][0]).abs() < 0.03, "{behind} against {}", 0.2 * per_second);
        assert_ne!(now[22].dlo, late[22].dlo);
    }
}
