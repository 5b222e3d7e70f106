//! An image that drifts.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::axis::Axis;
use super::signed;
use crate::episode_model::ObservationTerm;
use std::sync::Arc;

/// Rate in half masks per second.
struct Drift(f64, Axis);

impl ObservationTerm for Drift {
    fn change(&self, time_s: f64, keypoints: &mut [[f64; 2]; 4]) {
        self.1.shift(self.0 * time_s, keypoints);
    }
}

/// Templates `template_camera_drift_x_1_s` and `template_camera_drift_z_1_s`: the image drifts steadily.
pub fn effect(axis: Axis) -> TermEffect {
    let [name, title, description] = match axis {
        Axis::Across => [
            "template_camera_drift_x_1_s",
            "drift of the image, across",
            "rate at which the image drifts to the right, in half images",
        ],
        Axis::Up => [
            "template_camera_drift_z_1_s",
            "drift of the image, upwards",
            "rate at which the image drifts up, in half images",
        ],
    };
    TermEffect::new(
        // A sixth of the half image over a task of 8 s.
        signed([name, title, description, "1/s"], Hook::Observation, [0.02, 1.0]),
        &[],
        move |magnitude, episode| episode.camera.terms.push(Arc::new(Drift(magnitude, axis))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;
    use super::Axis;
    use crate::imperfect_camera::ImperfectCamera;

    #[test]
    fn all_keypoints_move_at_the_rate_along_their_axis() {
        let seen = |axis, time_s| {
            let settings = fixtures::template(&super::effect(axis), 0.02, [0.5, 1.0], 2e4).camera;
            let mut camera = ImperfectCamera::new(&settings, settings.view, None, None);
            camera.capture(time_s, [[0.4, 0.2], [0.42, 0.25], [0.45, 0.3], [0.5, 0.2]])
        };
        for (axis, [u, v]) in [(Axis::Across, [0.06, 0.0]), (Axis::Up, [0.0, -0.06])] {
            for (before, after) in seen(axis, 0.0).iter().zip(seen(axis, 3.0)) {
                assert!((after[0] - before[0] - u).abs() < 1e-12 && (after[1] - before[1] - v).abs() < 1e-12);
            }
        }
    }
}
