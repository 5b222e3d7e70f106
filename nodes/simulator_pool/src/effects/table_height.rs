//! Height of the table.

use super::{About, Effect, Hook, uniform};
use crate::world::{NO_TABLE, World};

/// Height of the table.
pub(super) struct TableHeight;

impl Effect for TableHeight {
    fn about(&self) -> About {
        About {
            name: "table_height_change_m",
            title: "table height",
            description: "how much higher the table stands",
            unit: "m",
            hook: Hook::Force,
            prior: uniform(-0.02, 0.02),
            range: [-1.0, 1.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.table.as_mut().ok_or(NO_TABLE)?.height_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::TableHeight;
    use crate::beam::Table;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&TableHeight);
    }

    #[test]
    fn a_lying_bar_is_lifted() {
        let height_m = |m| {
            let parameters =
                trial::beam(&TableHeight, m, 5e4, |b| (b.clamped, b.table) = (false, Some(Table::new(-0.0075, 0.4))));
            trial::at_rest(parameters, 0.0).tip()[1]
        };
        trial::close(height_m(0.012) - height_m(0.0), 0.012, 1e-3);
    }
}
