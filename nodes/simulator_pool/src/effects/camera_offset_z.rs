//! Camera moved along z.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Camera moved along z.
pub(super) struct CameraOffsetZ;

impl Effect for CameraOffsetZ {
    fn about(&self) -> About {
        About {
            name: "camera_offset_z_m",
            title: "camera offset along z",
            description: "how far the camera stands from where the model says, along z",
            unit: "m",
            hook: Hook::Observation,
            prior: uniform(-0.03, 0.03),
            range: [-1.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.camera = world.view.camera.moved([0.0, 0.0, magnitude]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::CameraOffsetZ;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&CameraOffsetZ);
    }

    #[test]
    fn the_moved_camera_sees_the_moved_point_where_it_saw_the_first() {
        let (base, moved) =
            (trial::world(&CameraOffsetZ, 0.0).view.camera, trial::world(&CameraOffsetZ, -0.02).view.camera);
        let (a, b) =
            (moved.scaled_from_world([0.4, 0.0, 0.2]).unwrap(), base.scaled_from_world([0.4, 0.0, 0.22]).unwrap());
        assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12, "{a:?} {b:?}");
    }
}
