//! Axial stiffness that is not that of a solid section.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::EpisodeModel;

/// Effect `axial_stiffness_log_ratio`: axial stiffness beside that of the model.
pub(super) struct AxialStiffness;

impl Effect for AxialStiffness {
    fn about(&self) -> About {
        About {
            name: "axial_stiffness_log_ratio",
            title: "axial stiffness",
            description: "natural logarithm of the axial stiffness over that of the model: larger stretches less; bending stays",
            unit: "1",
            hook: Hook::Material,
            // Ropes and cables with a core are up to some hundred times as stiff along the axis as a solid section of their bending
            // stiffness; foams and braids that lie loose are softer.
            prior: uniform(-3.0, 6.0),
            // Stiffer by 3000, nothing stretches that a camera could see.
            range: [-5.0, 8.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        // Not even the last bit of a model without the effect changes.
        if magnitude != 0.0 {
            episode.beam.axial_stiffness_n *= magnitude.exp();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN, GRAVITY, THETA};
    use super::AxialStiffness;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&AxialStiffness);
    }

    #[test]
    fn a_hanging_bar_stretches_by_the_inverse_ratio() {
        let stretched_m = |magnitude: f64| {
            let p = fixtures::beam(&AxialStiffness, magnitude, 2e4, |_| ());
            (p.mass_kg(), fixtures::at_rest(p, DOWN).deformed_length_m() - THETA[0])
        };
        for magnitude in [-0.5, 0.0, 3.0] {
            let (mass_kg, got) = stretched_m(magnitude);
            // Half the weight over the axial stiffness of a square of 15 mm.
            let expected = 0.5 * mass_kg * GRAVITY * THETA[0] / (2e4 * 0.015 * 0.015 * magnitude.exp());
            fixtures::close(got, expected, 1e-6);
        }
    }
}
