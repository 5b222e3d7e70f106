//! The other axial law.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `axial_law_change`: the other axial law.
pub(super) struct AxialLawChange;

impl Effect for AxialLawChange {
    fn about(&self) -> About {
        About {
            name: "axial_law_change",
            title: "axial law",
            description: "share of the axial law other than the model's: neo-Hookean if the model is linear, and the reverse",
            unit: "1",
            hook: Hook::Material,
            // A share: every mixture of the two laws is as likely.
            prior: uniform(0.0, 1.0),
            range: [0.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.other_law_share += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN};
    use super::AxialLawChange;
    use catenary_core::model::AxialLaw;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&AxialLawChange);
    }

    #[test]
    fn all_of_it_is_the_other_law_and_half_of_it_lies_between() {
        let length_m = |law, magnitude| {
            fixtures::at_rest(fixtures::beam(&AxialLawChange, magnitude, 3e3, |b| b.axial_law = law), DOWN)
                .deformed_length_m()
        };
        let (linear, neo_hookean) = (length_m(AxialLaw::Linear, 0.0), length_m(AxialLaw::NeoHookean, 0.0));
        fixtures::close(length_m(AxialLaw::Linear, 1.0), neo_hookean, 1e-9);
        fixtures::close(length_m(AxialLaw::NeoHookean, 1.0), linear, 1e-9);
        let half = length_m(AxialLaw::Linear, 0.5);
        assert!(half > linear.min(neo_hookean) + 1e-3 && half < linear.max(neo_hookean) - 1e-3, "{half}");
    }
}
