//! Soft fingers.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `grip_compliance_rad_n_m`: soft fingers.
pub(super) struct GripCompliance;

impl Effect for GripCompliance {
    fn about(&self) -> About {
        About {
            name: "grip_compliance_rad_n_m",
            title: "grip compliance",
            description: "turn of the held end per moment: how soft the fingers are",
            unit: "rad/(N m)",
            hook: Hook::Boundary,
            // The weight of a level soft bar of 0.25 m (a moment of 0.07 N m) turns the held end by 0.007 rad at the
            // low end.
            prior: log_uniform(0.1, 100.0),
            range: [0.0, 1e4],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.grip_compliance_rad_n_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::GripCompliance;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&GripCompliance);
    }

    #[test]
    fn the_held_section_turns_in_proportion_to_its_moment() {
        let magnitude = 2.0;
        let beam = fixtures::at_rest(fixtures::beam(&GripCompliance, magnitude, 1e6, |_| ()), 0.0);
        let (turn_rad, moment_n_m) = (beam.nodes()[0][2], beam.grip_reaction().moment_n_m);
        assert!(turn_rad < -0.05, "it sags: {turn_rad} rad");
        fixtures::close(turn_rad, -magnitude * moment_n_m, 1e-5);
    }
}
