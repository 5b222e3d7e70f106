//! Exposure blur.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Exposure blur.
pub(super) struct Exposure;

impl Effect for Exposure {
    fn about(&self) -> About {
        About {
            name: "exposure_s",
            title: "exposure",
            description: "time over which a frame gathers light: a moving object is seen at its mean place",
            unit: "s",
            hook: Hook::Observation,
            prior: log_uniform(1e-3, 0.05),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.exposure_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::Exposure;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&Exposure);
    }

    /// A point that moves steadily is seen where it was half an exposure ago.
    #[test]
    fn frames_show_the_mean_place() {
        trial::is_seen_late(&Exposure, 0.04, 0.2, 0.02);
    }
}
