//! An arm that undershoots at speed.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::episode_model::DisplacementTerm;
use std::sync::Arc;

/// Displacement in m of which the arm loses the share of the magnitude: the largest step of a task.
const AT_M: f64 = 0.06;

/// Lost share of a displacement of [`AT_M`].
struct Loss(f64);

impl DisplacementTerm for Loss {
    fn excess_m(&self, displacement_m: [f64; 2]) -> [f64; 2] {
        let [x, z] = displacement_m;
        displacement_m.map(|d| -self.0 * x.hypot(z) / AT_M * d)
    }
}

/// Effect `undershoot`: the arm falls short of large displacements, by a share that grows with them.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("undershoot", "undershoot at speed", "1", Hook::Actuation, log_uniform(1e-3, 0.5), 1.0),
        &[],
        |magnitude, episode| episode.arm.displacements.push(Arc::new(Loss(magnitude))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;
    use crate::arm::ArmModel;

    #[test]
    fn a_half_displacement_loses_half_the_share() {
        let goes_m = |delta_m: f64| {
            let mut arm = ArmModel::new(&fixtures::episode_model(&super::effect(), 0.2).arm, [0.4, 0.4]);
            arm.set_delta(0.0, [delta_m, 0.0]);
            arm.run_to(20.0);
            arm.position_m(20.0)[0] - 0.4
        };
        fixtures::close(goes_m(0.06), 0.06 * 0.8, 1e-9);
        fixtures::close(goes_m(-0.03), -0.03 * 0.9, 1e-9);
    }
}
