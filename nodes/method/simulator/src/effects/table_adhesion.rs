//! Adhesion to the table.

use super::effect::{About, Effect, Hook, log_uniform};
use crate::episode_model::{EpisodeModel, NO_TABLE};

/// Effect `table_adhesion_n_m`: adhesion to the table.
pub(super) struct TableAdhesion;

impl Effect for TableAdhesion {
    fn about(&self) -> About {
        About {
            name: "table_adhesion_n_m",
            title: "table adhesion",
            description: "pull of the table on the touching object, per length",
            unit: "N/m",
            hook: Hook::Force,
            // From 1 % of the weight of a soft bar (2.3 N/m) to twice the weight.
            prior: log_uniform(0.02, 5.0),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.table.as_mut().ok_or(NO_TABLE)?.adhesion_n_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{self, THETA};
    use super::TableAdhesion;
    use crate::beam::Table;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&TableAdhesion);
    }

    #[test]
    fn a_lying_bar_is_pressed_down_by_its_length() {
        let pressed_n = |m| {
            let parameters = fixtures::beam(&TableAdhesion, m, 5e4, |b| {
                (b.clamped, b.table) = (false, Some(Table::new(-0.0075, 0.4)))
            });
            fixtures::at_rest(parameters, 0.0).table_force().normal_n
        };
        fixtures::close(pressed_n(1.5) - pressed_n(0.0), 1.5 * THETA[0], 1e-3);
    }
}
