//! Lens distortion.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Lens distortion.
pub(super) struct LensDistortion;

impl Effect for LensDistortion {
    fn about(&self) -> About {
        About {
            name: "lens_distortion",
            title: "lens distortion",
            description: "first radial coefficient of the lens: negative is a barrel",
            unit: "1",
            hook: Hook::Observation,
            prior: uniform(-0.3, 0.3),
            range: [-0.33, 2.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.camera = world.view.camera.distorted(magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::LensDistortion;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&LensDistortion);
    }

    /// The shipped bar's camera: 615 px of focal length, and a mask of 256 px from an image of 480.
    #[test]
    fn a_point_moves_along_its_radius_by_the_first_coefficient() {
        let [a, b] = [0.0, -0.2].map(|k| trial::seen(&LensDistortion, k, [0.6, 0.1]));
        let focal_lengths = a[0].hypot(a[1]) * 240.0 / 615.0;
        let factor = 1.0 - 0.2 * focal_lengths * focal_lengths;
        trial::close(b[0], factor * a[0], 1e-9);
        trial::close(b[1], factor * a[1], 1e-9);
    }
}
