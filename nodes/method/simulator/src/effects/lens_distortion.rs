//! Lens distortion.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `lens_distortion`: lens distortion.
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
            // Above -1/3, at which radii r + k r^3 fold back one focal length off the axis.
            range: [-0.33, 2.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.view = episode.camera.view.distorted(magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::LensDistortion;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&LensDistortion);
    }

    /// The shipped bar's camera: 615 px of focal length, and a mask of 256 px from an image of 480.
    #[test]
    fn a_point_moves_along_its_radius_by_the_first_coefficient() {
        let [a, b] = [0.0, -0.2].map(|k| fixtures::seen(&LensDistortion, k, [0.6, 0.1]));
        let focal_lengths = a[0].hypot(a[1]) * 240.0 / 615.0;
        let factor = 1.0 - 0.2 * focal_lengths * focal_lengths;
        fixtures::close(b[0], factor * a[0], 1e-9);
        fixtures::close(b[1], factor * a[1], 1e-9);
    }
}
