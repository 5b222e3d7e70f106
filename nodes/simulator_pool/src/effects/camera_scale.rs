//! Scale of the camera.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Scale of the camera.
pub(super) struct CameraScale;

impl Effect for CameraScale {
    fn about(&self) -> About {
        About {
            name: "camera_scale_change",
            title: "camera scale",
            description: "relative change of the focal length: everything looks larger",
            unit: "1",
            hook: Hook::Observation,
            prior: uniform(-0.1, 0.1),
            range: [-0.9, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.camera = world.view.camera.enlarged(1.0 + magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::CameraScale;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&CameraScale);
    }

    #[test]
    fn everything_looks_larger() {
        let (base, near) = (trial::world(&CameraScale, 0.0).view.camera, trial::world(&CameraScale, 0.05).view.camera);
        let (a, b) =
            (base.scaled_from_world([0.5, 0.0, 0.2]).unwrap(), near.scaled_from_world([0.5, 0.0, 0.2]).unwrap());
        trial::close(b[0], 1.05 * a[0], 1e-12);
        trial::close(b[1], 1.05 * a[1], 1e-12);
    }
}
