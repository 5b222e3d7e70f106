//! Camera moved along z.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `camera_offset_z_m`: camera moved along z.
pub(super) struct CameraOffsetZ;

impl Effect for CameraOffsetZ {
    fn about(&self) -> About {
        About {
            name: "camera_offset_z_m",
            title: "camera offset along z",
            description: "offset of the camera from its place in the model, along z",
            unit: "m",
            hook: Hook::Observation,
            // Six times the jitter of the shipped cameras' position (5 mm).
            prior: uniform(-0.03, 0.03),
            range: [-1.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.view = episode.camera.view.moved([0.0, 0.0, magnitude]);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::CameraOffsetZ;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&CameraOffsetZ);
    }

    #[test]
    fn the_moved_camera_sees_the_moved_point_where_it_saw_the_first() {
        let (base, moved) = (
            fixtures::episode_model(&CameraOffsetZ, 0.0).camera.view,
            fixtures::episode_model(&CameraOffsetZ, -0.02).camera.view,
        );
        let (a, b) =
            (moved.scaled_from_world([0.4, 0.0, 0.2]).unwrap(), base.scaled_from_world([0.4, 0.0, 0.22]).unwrap());
        assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12, "{a:?} {b:?}");
    }
}
