//! Density.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `density_change`: density.
pub(super) struct Density;

impl Effect for Density {
    fn about(&self) -> About {
        About {
            name: "density_change",
            title: "density",
            description: "relative change of the density",
            unit: "1",
            hook: Hook::Material,
            prior: uniform(-0.3, 0.3),
            // Above -1, at which the object would have no mass.
            range: [-0.9, 10.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.mass_per_length_kg_m *= 1.0 + magnitude;
        episode.beam.rotary_inertia_per_length_kg_m *= 1.0 + magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN};
    use super::Density;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&Density);
    }

    #[test]
    fn weight_grows_by_the_share() {
        let weight_n = |m| fixtures::at_rest(fixtures::beam(&Density, m, 2e4, |_| ()), DOWN).grip_reaction().force_z_n;
        fixtures::close(weight_n(0.25), 1.25 * weight_n(0.0), 1e-6);
    }
}
