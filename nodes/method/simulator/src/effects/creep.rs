//! Creep.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `creep_fraction`: creep.
pub(super) struct Creep;

impl Effect for Creep {
    fn about(&self) -> About {
        About {
            name: "creep_fraction",
            title: "creep",
            description: "share of its stiffness that the object loses while it is held bent or stretched, over creep_time_s",
            unit: "1",
            hook: Hook::Material,
            prior: log_uniform(0.01, 0.6),
            // Below 1, at which a strain held for ever would have no stress.
            range: [0.0, 0.95],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.creep_fraction += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN};
    use super::Creep;
    use crate::beam::GripState;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&Creep);
    }

    /// Standard linear solid: under a constant load the strain grows from e to e (1 + m / (1 - m) (1 - exp(-(1 - m) t /
    /// T))).
    #[test]
    fn a_hanging_bar_grows_as_the_standard_linear_solid() {
        let magnitude = 0.4;
        // A little damping, so that the bar does not swing about the slow growth.
        let parameters =
            fixtures::beam(&Creep, magnitude, 2e4, |b| (b.creep_time_s, b.kelvin_voigt_time_s) = (0.8, 0.02));
        let mut beam = fixtures::at_rest(parameters, DOWN);
        let grip = GripState { tangent_rad: DOWN, ..GripState::default() };
        let elongation_m = |beam: &crate::beam::Beam| beam.deformed_length_m() - fixtures::THETA[0];
        let new_m = elongation_m(&beam);
        for time_s in [0.5, 1.0, 4.0] {
            beam.advance_to(time_s, |_| grip);
            let grown = 1.0 + magnitude / (1.0 - magnitude) * (1.0 - (-(1.0 - magnitude) * time_s / 0.8).exp());
            fixtures::close(elongation_m(&beam), grown * new_m, 0.02);
        }
    }
}
