//! Height of the table.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::{EpisodeModel, NO_TABLE};

/// Effect `table_height_change_m`: height of the table.
pub(super) struct TableHeight;

impl Effect for TableHeight {
    fn about(&self) -> About {
        About {
            name: "table_height_change_m",
            title: "table height",
            description: "change of the height of the table",
            unit: "m",
            hook: Hook::Force,
            // Somewhat more than the height of the shipped bar (15 mm).
            prior: uniform(-0.02, 0.02),
            range: [-1.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.beam.table.as_mut().ok_or(NO_TABLE)?.height_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::TableHeight;
    use crate::beam::Table;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&TableHeight);
    }

    #[test]
    fn a_lying_bar_is_lifted() {
        let height_m = |m| {
            let parameters = fixtures::beam(&TableHeight, m, 5e4, |b| {
                (b.clamped, b.table) = (false, Some(Table::new(-0.0075, 0.4)))
            });
            fixtures::at_rest(parameters, 0.0).tip()[1]
        };
        fixtures::close(height_m(0.012) - height_m(0.0), 0.012, 1e-3);
    }
}
