//! A hand that trembles.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::beam::{GripReaction, GripState, GripTerm};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Frequency of the tremor in Hz: its mean, its greatest distance from the mean, and the frequency at which it wanders.
// A hand trembles at 3 Hz, more or less: at a steady frequency the tremor would be a template.
const MEAN_HZ: f64 = 3.0;
const WANDERS_BY_HZ: f64 = 0.8;
const WANDERS_AT_HZ: f64 = 0.3;

/// Amplitude in rad.
struct Trembling(f64);

impl GripTerm for Trembling {
    fn change(&self, time_s: f64, _: &GripReaction, grip: &mut GripState) {
        // The phase is the integral of the frequency.
        let wander = WANDERS_BY_HZ / WANDERS_AT_HZ * (1.0 - (TAU * WANDERS_AT_HZ * time_s).cos());
        grip.tangent_rad += self.0 * (TAU * MEAN_HZ * time_s + wander).sin();
    }
}

/// Effect `tremor_rad`: a hand that trembles unseen by the encoders.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("tremor_rad", "tremor of the hand", "rad", Hook::Boundary, log_uniform(1e-3, 0.3), 1.0),
        &[],
        |magnitude, episode| episode.terms.grips.push(Arc::new(Trembling(magnitude))),
    )
}
