//! A wrong start: the object is let go when the recording begins.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::beam::{ForceTerm, PointState};
use std::sync::Arc;

/// Time in s since the start at which the object is let go.
// Longer than the longest time step, 4 ms: the shape at rest is that under the pull.
const LET_GO_S: f64 = 5e-3;

/// Force in N/m.
struct Pull(f64);

impl ForceTerm for Pull {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        if at.time_s < LET_GO_S { [self.0 * at.length_m, 0.0] } else { [0.0; 2] }
    }
}

/// Effect `start_pull_n_m`, a wrong start, in the part of the library's effects on the start: a pull along x holds the object aside until the recording begins, so that it swings although it
/// seems to hang at rest.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("start_pull_n_m", "pull until the start", "N/m", Hook::Boundary, log_uniform(1e-3, 2.0), 100.0),
        &[],
        |magnitude, episode| episode.terms.forces.push(Arc::new(Pull(magnitude))),
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{self, DOWN};
    use crate::beam::GripState;

    #[test]
    fn the_object_hangs_aside_and_swings_back_through_the_middle() {
        let mut beam = fixtures::held(&fixtures::episode_model(&super::effect(), 0.5), 20, DOWN);
        let aside_m = beam.tip()[0];
        let grip = GripState { tangent_rad: DOWN, ..GripState::default() };
        let swing: Vec<f64> = (1..100)
            .map(|i| {
                beam.advance_to(0.01 * f64::from(i), |_| grip);
                beam.tip()[0]
            })
            .collect();
        let farthest_m = swing.iter().copied().fold(f64::INFINITY, f64::min);
        // An undamped swing goes about as far to the other side.
        assert!(aside_m > 5e-3 && farthest_m < -0.6 * aside_m, "{aside_m} {farthest_m}");
    }
}
