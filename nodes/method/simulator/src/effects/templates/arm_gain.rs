//! An arm that executes more or less than each commanded displacement.

use super::super::effect::Hook;
use super::super::term_effect::TermEffect;
use super::signed;
use crate::episode_model::DisplacementTerm;
use std::sync::Arc;

/// Excess of a displacement, as a share of it.
struct Gain(f64);

impl DisplacementTerm for Gain {
    fn excess_m(&self, displacement_m: [f64; 2]) -> [f64; 2] {
        displacement_m.map(|d| self.0 * d)
    }
}

/// Template `template_arm_gain`: the arm executes (1 + m) of each commanded displacement.
pub fn effect() -> TermEffect {
    TermEffect::new(
        // A fifth of a displacement of 6 cm is 12 mm.
        signed(
            ["template_arm_gain", "gain of the arm", "share by which the arm exceeds each commanded displacement", "1"],
            Hook::Actuation,
            [0.2, 0.9],
        ),
        &[],
        |magnitude, episode| episode.arm.displacements.push(Arc::new(Gain(magnitude))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures;
    use crate::arm::ArmModel;

    /// The shipped bar's deltas are added to the last target.
    #[test]
    fn displacements_are_executed_with_the_gain_and_commanded_without() {
        let model = fixtures::template(&super::effect(), 0.1, [0.5, 1.0], 2e4);
        let mut arm = ArmModel::new(&model.arm, [0.4, 0.4]);
        arm.set_delta(0.0, [0.05, 0.0]);
        arm.set_delta(0.5, [0.02, -0.04]);
        arm.run_to(20.0);
        let ([x, z], [x_asked, z_asked]) = (arm.position_m(20.0), arm.target_m());
        assert!((x - 0.477).abs() < 1e-9 && (z - 0.356).abs() < 1e-9, "{x} {z}");
        assert!((x_asked - 0.47).abs() < 1e-12 && (z_asked - 0.36).abs() < 1e-12);
    }
}
