//! Camera rolled.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Camera rolled.
pub(super) struct CameraTilt;

impl Effect for CameraTilt {
    fn about(&self) -> About {
        About {
            name: "camera_tilt_rad",
            title: "camera tilt",
            description: "roll of the camera about its axis, clockwise as it looks: the picture turns counter-clockwise",
            unit: "rad",
            hook: Hook::Observation,
            prior: uniform(-0.1, 0.1),
            range: [-1.6, 1.6],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.camera = world.view.camera.rolled(magnitude);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::CameraTilt;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&CameraTilt);
    }

    #[test]
    fn the_picture_turns_about_its_middle() {
        let [[u, v], [a, b]] = [0.0, 0.1].map(|tilt| trial::seen(&CameraTilt, tilt, [0.5, 0.2]));
        let (sin, cos) = 0.1f64.sin_cos();
        // Image coordinates: v points down, and the picture turns counter-clockwise.
        assert!(
            (a - (cos * u + sin * v)).abs() < 1e-12 && (b - (cos * v - sin * u)).abs() < 1e-12,
            "{a} {b} from {u} {v}"
        );
    }
}
