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
    use crate::view::Eye;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&Exposure);
    }

    /// A point that moves steadily is seen where it was half an exposure ago.
    #[test]
    fn frames_show_the_mean_place() {
        let world = trial::world(&Exposure, 0.04);
        let mut eye = Eye::new(&world.view, world.view.camera, None, None);
        let places = |t: f64| [[0.5 + 0.5 * t, 0.2]; 4];
        (0..50).for_each(|i| eye.remember(2e-3 * f64::from(i), places(2e-3 * f64::from(i))));
        let seen = eye.look(0.1, places(0.1))[0][0];
        let [expected, _] = world.view.camera.scaled_from_world([0.5 + 0.5 * 0.08, 0.0, 0.2]).unwrap();
        trial::close(seen, expected, 1e-4);
    }
}
