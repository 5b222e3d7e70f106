//! A grip that loosens.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::beam::{GripReaction, GripState, GripTerm};
use std::sync::Arc;

/// Time in s at which the turn has the size of the magnitude: the duration of a task.
const AT_S: f64 = 8.0;

/// Turn in rad after [`AT_S`].
struct Turn(f64);

impl GripTerm for Turn {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        grip.tangent_rad -= self.0 * (time_s / AT_S).powi(2);
    }
}

/// Effect `loosening_grip_rad`: the held section turns, first hardly and then faster and faster.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("loosening_grip_rad", "loosening grip", "rad", Hook::Boundary, log_uniform(1e-3, 1.0), 3.0),
        &[],
        |magnitude, episode| episode.terms.grips.push(Arc::new(Turn(magnitude))),
    )
}
