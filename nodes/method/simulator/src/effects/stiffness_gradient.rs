//! Stiffness that changes along the object.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `stiffness_gradient`: stiffness that changes along the object.
pub(super) struct StiffnessGradient;

impl Effect for StiffnessGradient {
    fn about(&self) -> About {
        About {
            name: "stiffness_gradient",
            title: "stiffness gradient",
            description: "relative change of stiffness along the object: softer at the grip and stiffer at the tip by this share of the mean",
            unit: "1",
            hook: Hook::Material,
            prior: uniform(-0.8, 0.8),
            // Within -1 to 1, at which one end would have no stiffness.
            range: [-0.95, 0.95],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.stiffness_gradient += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN, GRAVITY, THETA};
    use super::StiffnessGradient;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&StiffnessGradient);
    }

    #[test]
    fn a_hanging_bar_stretches_as_its_stiffness_allows() {
        let (magnitude, e) = (0.6, 5e4);
        let elongation_m = fixtures::at_rest(fixtures::beam(&StiffnessGradient, magnitude, e, |_| ()), DOWN)
            .deformed_length_m()
            - THETA[0];
        // The load at a place is the weight below it.
        let piece = |i: i32| {
            let s = (f64::from(i) + 0.5) / 1000.0;
            1055.0 * GRAVITY * THETA[0] * THETA[0] * (1.0 - s) / (e * (1.0 + magnitude * (2.0 * s - 1.0))) / 1000.0
        };
        fixtures::close(elongation_m, (0..1000).map(piece).sum(), 5e-3);
    }
}
