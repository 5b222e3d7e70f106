//! Friction within the object, by Dahl's law.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::beam::{HystereticTerm, Reply};
use std::sync::Arc;

/// Change of curvature in 1/m over which the moment approaches its limit.
// A hanging bar bends by some 1/m: small motions stick, large ones slip.
const REACH_PER_M: f64 = 1.0;

/// Limit of the moment in N m.
struct Dahl(f64);

impl HystereticTerm for Dahl {
    fn reply(&self, moment_n_m: f64, change_per_m: f64) -> Reply {
        let limit = self.0.copysign(change_per_m);
        let left = (-change_per_m.abs() / REACH_PER_M).exp();
        let moment = limit + (moment_n_m - limit) * left;
        // Integral of the moment over the change. It is convex, because the moment grows with the change.
        let reach = REACH_PER_M.copysign(change_per_m);
        Reply {
            energy_j_m: limit * change_per_m + (moment_n_m - limit) * (1.0 - left) * reach,
            moment_n_m: moment,
            stiffness_n_m2: (limit - moment_n_m) * left / reach,
        }
    }
}

/// Effect `dahl_friction_n_m`: a bending moment that approaches its limit exponentially after each turn of the motion (Dahl
/// 1968, "A solid friction model"): dM / dk = (limit - sign(dk) M) / reach.
///
/// The library's friction between strands is a line up to a corner instead.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("dahl_friction_n_m", "friction by Dahl's law", "N m", Hook::Material, log_uniform(1e-6, 0.1), 10.0),
        &[],
        |magnitude, episode| {
            // Without a limit there is no moment, and no memory of one.
            if magnitude > 0.0 {
                episode.terms.hystereses.push(Arc::new(Dahl(magnitude)));
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN};
    use super::{Dahl, REACH_PER_M};
    use crate::beam::{GripState, HystereticTerm};

    /// A cycle of amplitude A loses 4 limit (A - reach tanh(A / reach)).
    #[test]
    fn a_cycle_encloses_the_energy_of_the_closed_form() {
        let (dahl, amplitude) = (Dahl(0.02), 1.5);
        let (mut moment, mut lost, mut last) = (0.0, 0.0, 0.0);
        // Only the last cycle counts: the first begins in the middle of the loop.
        for i in 0..16_000 {
            let curvature = amplitude * (std::f64::consts::TAU * f64::from(i) / 4000.0).sin();
            let reply = dahl.reply(moment, curvature - last);
            lost += if i >= 12_000 { reply.energy_j_m } else { 0.0 };
            (moment, last) = (reply.moment_n_m, curvature);
        }
        let expected = 4.0 * 0.02 * (amplitude - REACH_PER_M * (amplitude / REACH_PER_M).tanh());
        fixtures::close(lost, expected, 2e-3);
    }

    #[test]
    fn moment_and_stiffness_are_derivatives_of_the_energy() {
        let dahl = Dahl(0.3);
        for (before, change) in [(0.0, 0.4), (0.2, -0.7), (-0.25, 0.01), (0.1, -1e-3)] {
            let step = 1e-6;
            let (less, more) = (dahl.reply(before, change - step), dahl.reply(before, change + step));
            let at = dahl.reply(before, change);
            fixtures::close((more.energy_j_m - less.energy_j_m) / (2.0 * step), at.moment_n_m, 1e-6);
            fixtures::close((more.moment_n_m - less.moment_n_m) / (2.0 * step), at.stiffness_n_m2, 1e-6);
            assert!(at.stiffness_n_m2 > 0.0);
        }
    }

    #[test]
    fn a_swing_dies_by_it_alone() {
        let swings_m = |limit_n_m| {
            let model = fixtures::episode_model(&super::effect(), limit_n_m);
            let mut beam = fixtures::held(&model, 20, DOWN);
            beam.set_velocity([0.4, 0.0]);
            let grip = GripState { tangent_rad: DOWN, ..GripState::default() };
            let tip = |i: i32, beam: &mut crate::beam::Beam| {
                beam.advance_to(0.02 * f64::from(i), |_| grip);
                beam.tip()[0].abs()
            };
            (0..250).map(|i| tip(i, &mut beam)).skip(200).fold(0.0, f64::max)
        };
        let (free_m, held_m) = (swings_m(0.0), swings_m(2e-3));
        assert!(held_m < 0.5 * free_m && free_m > 0.01, "{held_m} of {free_m}");
    }
}
