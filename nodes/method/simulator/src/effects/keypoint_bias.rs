//! Bias of the keypoints.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `keypoint_bias`: bias of the keypoints.
pub(super) struct KeypointBias;

impl Effect for KeypointBias {
    fn about(&self) -> About {
        About {
            name: "keypoint_bias",
            title: "keypoint bias",
            description: "shift of the keypoints towards the tip, as a share of the visible length",
            unit: "1",
            hook: Hook::Observation,
            // 5 % of a bar of 0.25 m are 12 mm, five standard deviations of the keypoints' noise.
            prior: uniform(-0.05, 0.05),
            range: [-0.5, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.camera.keypoint_shift += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::KeypointBias;
    use crate::effects::Registry;
    use crate::episode::{Conditions, EpisodeSimulation};
    use crate::parameters::tests::soft_bar;
    use catenary_core::{Fidelity, GripPose};

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&KeypointBias);
    }

    /// The first keypoint lies at an eighth of the length and the second at three eighths.
    #[test]
    fn a_quarter_of_the_length_makes_the_first_keypoint_the_second() {
        let keypoints = |magnitude: f64| {
            let mut simulation = EpisodeSimulation::new(&soft_bar(), Registry::shipped(), Fidelity::Fast).unwrap();
            let effects = [("keypoint_bias".to_owned(), magnitude)];
            let conditions =
                Conditions { theta: &fixtures::THETA, effects: &effects, seed: 1, noise: false, target_m: None };
            simulation.prepare(&conditions).unwrap();
            simulation.hang(GripPose { x_m: 0.4, z_m: 0.42, pitch_rad: 0.0 });
            simulation.keypoints(0.0)
        };
        let (base, shifted) = (keypoints(0.0), keypoints(0.25));
        // The fingers hide 8 mm of the bar, and fractions count from there: a quarter is not exactly one keypoint.
        assert!((0..2).all(|i| (shifted[0][i] - base[1][i]).abs() < 0.02), "{shifted:?} {base:?}");
    }
}
