//! An image that swings with time.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::axis::Axis;
use super::wave::{Phase, Wave};
use super::{FREQUENCY, signed};
use crate::episode_model::ObservationTerm;
use std::sync::Arc;

/// Displacement in half images.
struct Swing(Wave, Axis);

impl ObservationTerm for Swing {
    fn change(&self, time_s: f64, keypoints: &mut [[f64; 2]; 4]) {
        self.1.shift(self.0.at(time_s), keypoints);
    }
}

/// Templates `template_harmonic_camera_x_sin` and its like: a harmonic displacement of the image along an axis.
pub fn effect(axis: Axis, phase: Phase) -> TermEffect {
    let [name, title, description] = match (axis, phase) {
        (Axis::Across, Phase::Sine) => [
            "template_harmonic_camera_x_sin",
            "harmonic motion of the image, across, sine",
            "displacement of the image to the right at template_frequency_hz, zero at the start, in half images",
        ],
        (Axis::Across, Phase::Cosine) => [
            "template_harmonic_camera_x_cos",
            "harmonic motion of the image, across, cosine",
            "displacement of the image to the right at template_frequency_hz, largest at the start, in half images",
        ],
        (Axis::Up, Phase::Sine) => [
            "template_harmonic_camera_z_sin",
            "harmonic motion of the image, upwards, sine",
            "displacement of the image up at template_frequency_hz, zero at the start, in half images",
        ],
        (Axis::Up, Phase::Cosine) => [
            "template_harmonic_camera_z_cos",
            "harmonic motion of the image, upwards, cosine",
            "displacement of the image up at template_frequency_hz, largest at the start, in half images",
        ],
    };
    TermEffect::new(
        // A drift of the image goes as far in a task of 8 s.
        signed([name, title, description, "1"], Hook::Observation, [0.16, 1.0]),
        &[FREQUENCY],
        move |magnitude, episode| {
            let wave = Wave::new(magnitude, &episode.templates, phase);
            episode.camera.terms.push(Arc::new(Swing(wave, axis)));
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;
    use super::{Axis, Phase};
    use crate::imperfect_camera::ImperfectCamera;
    use std::f64::consts::TAU;

    #[test]
    fn all_keypoints_follow_the_wave_along_their_axis() {
        let (magnitude, frequency_hz, time_s) = (0.05, 0.7, 0.3);
        let points = [[0.4, 0.2], [0.42, 0.25], [0.45, 0.3], [0.5, 0.2]];
        for (axis, [across, down]) in [(Axis::Across, [1.0, 0.0]), (Axis::Up, [0.0, -1.0])] {
            for phase in [Phase::Sine, Phase::Cosine] {
                let seen = |magnitude| {
                    let effect = super::effect(axis, phase);
                    let settings = fixtures::template(&effect, magnitude, [0.5, frequency_hz], 2e4).camera;
                    ImperfectCamera::new(&settings, settings.view, None, None).capture(time_s, points)
                };
                let way = magnitude * phase.at(TAU * frequency_hz * time_s);
                for (still, swung) in seen(0.0).iter().zip(seen(magnitude)) {
                    assert!((swung[0] - still[0] - across * way).abs() < 1e-12, "{axis:?} {phase:?}");
                    assert!((swung[1] - still[1] - down * way).abs() < 1e-12, "{axis:?} {phase:?}");
                }
            }
        }
    }
}
