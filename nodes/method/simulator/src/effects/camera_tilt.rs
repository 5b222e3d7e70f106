//! Roll of the camera about its optical axis.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `camera_tilt_rad`: camera rolled.
pub(super) struct CameraTilt;

impl Effect for CameraTilt {
    fn about(&self) -> About {
        About {
            name: "camera_tilt_rad",
            title: "camera tilt",
            description: "roll of the camera about its axis, clockwise as it looks: the picture turns counter-clockwise",
            unit: "rad",
            hook: Hook::Observation,
            // 0.1 rad moves a point at the picture's edge by 13 px of the mask.
            prior: uniform(-0.1, 0.1),
            range: [-1.6, 1.6],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.view = episode.camera.view.rolled(magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::CameraTilt;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&CameraTilt);
    }

    #[test]
    fn the_picture_turns_about_its_middle() {
        let [[u, v], [a, b]] = [0.0, 0.1].map(|tilt| fixtures::seen(&CameraTilt, tilt, [0.5, 0.2]));
        let (sin, cos) = 0.1f64.sin_cos();
        // Image coordinates: v points down, and the picture turns counter-clockwise.
        assert!(
            (a - (cos * u + sin * v)).abs() < 1e-12 && (b - (cos * v - sin * u)).abs() < 1e-12,
            "{a} {b} from {u} {v}"
        );
    }
}
