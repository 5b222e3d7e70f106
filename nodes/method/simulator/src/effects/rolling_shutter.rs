//! Rolling shutter.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `rolling_shutter_s`: rolling shutter.
pub(super) struct RollingShutter;

impl Effect for RollingShutter {
    fn about(&self) -> About {
        About {
            name: "rolling_shutter_s",
            title: "rolling shutter",
            description: "time by which the picture's first row is older than its last",
            unit: "s",
            hook: Hook::Observation,
            // Up to more than the period of a camera at 30 Hz (33 ms).
            prior: log_uniform(1e-3, 0.05),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.rolling_shutter_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::RollingShutter;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&RollingShutter);
    }

    /// The middle row shows a point half a read-out late.
    #[test]
    fn a_row_is_as_old_as_its_place_in_the_read_out() {
        fixtures::is_seen_late(&RollingShutter, 0.03, 0.27, 0.015);
    }
}
