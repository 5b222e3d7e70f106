//! Friction on the table.

use super::effect::{About, Effect, Hook, uniform};
use crate::episode_model::{EpisodeModel, NO_TABLE};

/// Effect `table_friction_change`: friction on the table.
pub(super) struct TableFriction;

impl Effect for TableFriction {
    fn about(&self) -> About {
        About {
            name: "table_friction_change",
            title: "table friction",
            description: "change of the coefficient of friction, which does not fall below zero",
            unit: "1",
            hook: Hook::Force,
            prior: uniform(-0.3, 0.3),
            range: [-5.0, 5.0],
        }
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        let table = episode.beam.table.as_mut().ok_or(NO_TABLE)?;
        // A negative coefficient would push the object along its motion.
        table.friction_coefficient = (table.friction_coefficient + magnitude).max(0.0);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures;
    use super::TableFriction;
    use crate::beam::{GripState, Table};

    #[test]
    fn zero_is_the_base_to_the_bit() {
        fixtures::zero_is_the_base(&TableFriction);
    }

    #[test]
    fn a_dragged_bar_feels_the_changed_coefficient() {
        for (magnitude, expected) in [(0.2, 0.6), (-0.15, 0.25), (-1.0, 0.0)] {
            let parameters = fixtures::beam(&TableFriction, magnitude, 5e4, |b| {
                (b.table, b.kelvin_voigt_time_s) = (Some(Table::new(-0.0075, 0.4)), 0.02);
            });
            let mut beam = fixtures::at_rest(parameters, 0.0);
            beam.advance_to(1.0, |t| GripState { x_m: 0.1 * t, ..GripState::default() });
            let force = beam.table_force();
            assert!(force.normal_n > 0.1, "{force:?}");
            assert!((-force.friction_n / force.normal_n - expected).abs() < 0.01, "{force:?} for {expected}");
        }
    }
}
