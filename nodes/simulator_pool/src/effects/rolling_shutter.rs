//! Rolling shutter.

use super::{About, Effect, Hook, log_uniform};
use crate::world::World;

/// Rolling shutter.
pub(super) struct RollingShutter;

impl Effect for RollingShutter {
    fn about(&self) -> About {
        About {
            name: "rolling_shutter_s",
            title: "rolling shutter",
            description: "time by which the picture's first row is older than its last",
            unit: "s",
            hook: Hook::Observation,
            prior: log_uniform(1e-3, 0.05),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.rolling_shutter_s += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::RollingShutter;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&RollingShutter);
    }

    /// A point in the middle row is seen where it was half a read-out ago.
    #[test]
    fn rows_are_as_old_as_their_place() {
        trial::is_seen_late(&RollingShutter, 0.03, 0.27, 0.015);
    }
}
