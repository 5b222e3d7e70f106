//! Camera moved along x.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Camera moved along x.
pub(super) struct CameraOffsetX;

impl Effect for CameraOffsetX {
    fn about(&self) -> About {
        About {
            name: "camera_offset_x_m",
            title: "camera offset along x",
            description: "how far the camera stands from where the model says, along x",
            unit: "m",
            hook: Hook::Observation,
            prior: uniform(-0.03, 0.03),
            range: [-1.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.camera = world.view.camera.moved([magnitude, 0.0, 0.0]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::CameraOffsetX;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&CameraOffsetX);
    }

    #[test]
    fn the_moved_camera_sees_the_moved_point_where_it_saw_the_first() {
        let (base, moved) =
            (trial::world(&CameraOffsetX, 0.0).view.camera, trial::world(&CameraOffsetX, 0.02).view.camera);
        let (a, b) =
            (moved.scaled_from_world([0.42, 0.0, 0.2]).unwrap(), base.scaled_from_world([0.4, 0.0, 0.2]).unwrap());
        assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12, "{a:?} {b:?}");
    }
}
