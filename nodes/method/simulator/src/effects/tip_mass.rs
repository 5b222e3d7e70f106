//! A mass at the tip.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `tip_mass_kg`: a mass at the tip.
pub(super) struct TipMass;

impl Effect for TipMass {
    fn about(&self) -> About {
        About {
            name: "tip_mass_kg",
            title: "tip mass",
            description: "point mass at the tip",
            unit: "kg",
            hook: Hook::Force,
            // From 0.2 % of the mass of a soft bar (60 g) to more than that of the measured cable (0.45 kg).
            prior: log_uniform(1e-4, 0.5),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.tip_mass_kg += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN, GRAVITY};
    use super::TipMass;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&TipMass);
    }

    #[test]
    fn the_grip_carries_its_weight() {
        let weight_n = |m| fixtures::at_rest(fixtures::beam(&TipMass, m, 2e4, |_| ()), DOWN).grip_reaction().force_z_n;
        fixtures::close(weight_n(0.02) - weight_n(0.0), 0.02 * GRAVITY, 1e-6);
    }
}
