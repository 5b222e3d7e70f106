//! Scale of the camera.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `camera_scale_change`: scale of the camera.
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
            // Above -1, at which the focal length would be zero.
            range: [-0.9, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.view = episode.camera.view.enlarged(1.0 + magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::CameraScale;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&CameraScale);
    }

    #[test]
    fn everything_looks_larger() {
        let (base, near) = (
            fixtures::episode_model(&CameraScale, 0.0).camera.view,
            fixtures::episode_model(&CameraScale, 0.05).camera.view,
        );
        let (a, b) =
            (base.scaled_from_world([0.5, 0.0, 0.2]).unwrap(), near.scaled_from_world([0.5, 0.0, 0.2]).unwrap());
        fixtures::close(b[0], 1.05 * a[0], 1e-12);
        fixtures::close(b[1], 1.05 * a[1], 1e-12);
    }
}
