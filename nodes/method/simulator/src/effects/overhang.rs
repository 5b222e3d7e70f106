//! An overhang behind the grip.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::EpisodeModel;

/// Effect `overhang_m`: an overhang behind the grip.
pub(super) struct Overhang;

impl Effect for Overhang {
    fn about(&self) -> About {
        About {
            name: "overhang_m",
            title: "overhang",
            description: "length of the object behind the grip, missing in front of it",
            unit: "m",
            hook: Hook::Boundary,
            prior: log_uniform(1e-3, 0.03),
            // The beam refuses an overhang of half its length or more.
            range: [0.0, 0.5],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.overhang_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, DOWN, THETA};
    use super::Overhang;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&Overhang);
    }

    #[test]
    fn the_part_before_the_grip_is_shorter_and_the_weight_stays() {
        let beam = |m| fixtures::at_rest(fixtures::beam(&Overhang, m, 1e7, |_| ()), DOWN);
        let (whole, held_in) = (beam(0.0), beam(0.02));
        fixtures::close(-held_in.tip()[1], THETA[0] - 0.02, 1e-3);
        fixtures::close(held_in.grip_reaction().force_z_n, whole.grip_reaction().force_z_n, 1e-6);
    }
}
