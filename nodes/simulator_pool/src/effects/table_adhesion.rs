//! Adhesion to the table.

use super::{About, Effect, Hook, log_uniform};
use crate::world::{NO_TABLE, World};

/// Adhesion to the table.
pub(super) struct TableAdhesion;

impl Effect for TableAdhesion {
    fn about(&self) -> About {
        About {
            name: "table_adhesion_n_m",
            title: "table adhesion",
            description: "pull of the table on what touches it, per length",
            unit: "N/m",
            hook: Hook::Force,
            prior: log_uniform(0.02, 5.0),
            range: [0.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.table.as_mut().ok_or(NO_TABLE)?.adhesion_n_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{self, THETA};
    use super::TableAdhesion;
    use crate::beam::Table;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&TableAdhesion);
    }

    #[test]
    fn a_lying_bar_is_pressed_down_by_its_length() {
        let pressed_n = |m| {
            let parameters =
                trial::beam(&TableAdhesion, m, 5e4, |b| (b.clamped, b.table) = (false, Some(Table::new(-0.0075, 0.4))));
            trial::at_rest(parameters, 0.0).table_force().normal_n
        };
        trial::close(pressed_n(1.5) - pressed_n(0.0), 1.5 * THETA[0], 1e-3);
    }
}
