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
    use crate::view::Eye;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&RollingShutter);
    }

    /// A point in the middle row is seen where it was half a read-out ago.
    #[test]
    fn rows_are_as_old_as_their_place() {
        let world = trial::world(&RollingShutter, 0.03);
        let mut eye = Eye::new(&world.view, world.view.camera, None, None);
        let places = |t: f64| [[0.5 + 0.5 * t, 0.27]; 4];
        (0..50).for_each(|i| eye.remember(2e-3 * f64::from(i), places(2e-3 * f64::from(i))));
        let seen = eye.look(0.1, places(0.1))[0][0];
        let [expected, _] = world.view.camera.scaled_from_world([0.5 + 0.5 * 0.085, 0.0, 0.27]).unwrap();
        trial::close(seen, expected, 1e-4);
    }
}
