//! Rest curvature.

use super::{About, Effect, Hook, uniform};
use crate::world::World;

/// Rest curvature.
pub(super) struct RestCurvature;

impl Effect for RestCurvature {
    fn about(&self) -> About {
        About {
            name: "rest_curvature_per_m",
            title: "rest curvature",
            description: "curvature of the unloaded centre line, counter-clockwise from the grip on",
            unit: "1/m",
            hook: Hook::Material,
            prior: uniform(-4.0, 4.0),
            range: [-100.0, 100.0],
        }
    }

    fn apply(&self, magnitude: f64, world: &mut World) -> Result<(), &'static str> {
        world.beam.rest_curvature_per_m += magnitude;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial;
    use super::RestCurvature;

    #[test]
    fn zero_is_the_base_to_the_bit() {
        trial::zero_is_the_base(&RestCurvature);
    }

    #[test]
    fn an_unloaded_bar_is_an_arc() {
        let magnitude = 2.0;
        let parameters = trial::beam(&RestCurvature, magnitude, 1e6, |b| b.gravity_m_s2 = [0.0, -1e-6]);
        let angle = magnitude * trial::THETA[0];
        let [x, z] = trial::at_rest(parameters, 0.0).tip();
        trial::close(x, angle.sin() / magnitude, 1e-3);
        trial::close(z, (1.0 - angle.cos()) / magnitude, 1e-3);
    }
}
