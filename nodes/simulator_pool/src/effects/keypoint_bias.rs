//! Bias of the keypoints.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Bias of the keypoints.
pub(super) struct KeypointBias;

impl Effect for KeypointBias {
    fn about(&self) -> About {
        About {
            name: "keypoint_bias",
            title: "keypoint bias",
            description: "shift of the keypoints towards the tip, as a share of the visible length",
            unit: "1",
            hook: Hook::Observation,
            prior: uniform(-0.05, 0.05),
            range: [-0.5, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.view.keypoint_shift += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::KeypointBias;
    use crate::effects::Registry;
    use crate::episode::{Conditions, Stage};
    use crate::parameters::tests::soft_bar;
    use catenary_core::{Fidelity, GripPose};

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&KeypointBias);
    }

    /// The first keypoint lies at an eighth of the length and the second at three eighths.
    #[test]
    fn a_quarter_of_the_length_makes_the_first_keypoint_the_second() {
        let keypoints = |magnitude: f64| {
            let mut stage = Stage::new(&soft_bar(), Registry::shipped(), Fidelity::Fast).unwrap();
            let effects = [("keypoint_bias".to_owned(), magnitude)];
            let conditions =
                Conditions { theta: &trial::THETA, effects: &effects, seed: 1, noise: false, target_m: None };
            stage.prepare(&conditions).unwrap();
            stage.hang(GripPose { x_m: 0.4, z_m: 0.42, pitch_rad: 0.0 });
            stage.keypoints(0.0)
        };
        let (base, shifted) = (keypoints(0.0), keypoints(0.25));
        // The model hides 8 mm in the fingers, and the fractions are of what is left.
        assert!((0..2).all(|i| (shifted[0][i] - base[1][i]).abs() < 0.02), "{shifted:?} {base:?}");
    }
}
