//! Dropped frames.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Dropped frames.
pub(super) struct DroppedFrames;

impl Effect for DroppedFrames {
    fn about(&self) -> About {
        About {
            name: "dropped_frames",
            title: "dropped frames",
            description: "share of frames that show what the one before showed",
            unit: "1",
            hook: Hook::Observation,
            prior: log_uniform(0.01, 0.5),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.dropped_share += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::DroppedFrames;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&DroppedFrames);
    }

    #[test]
    fn all_frames_dropped_repeat_the_first() {
        let frames = trial::episode(&[("dropped_frames", 1.0)], trial::gliding(0.02)).frames;
        assert!(frames.iter().all(|f| f.dlo == frames[0].dlo));
    }
}
