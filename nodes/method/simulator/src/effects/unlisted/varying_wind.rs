//! A wind of varying strength.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{FREQUENCY, about};
use crate::beam::{ForceTerm, PointState};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Frequency of the wind's second wave, relative to the first, its strength and its phase in rad.
// The golden ratio: the two waves never repeat together.
const SECOND: [f64; 3] = [1.618, 0.6, 1.0];

/// Mean force in N/m, and frequency in Hz of the first wave.
struct Wind(f64, f64);

impl ForceTerm for Wind {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        let angle = TAU * self.1 * at.time_s;
        let [ratio, strength, phase] = SECOND;
        let relative = 1.0 + angle.sin() + strength * (ratio * angle + phase).sin();
        [self.0 * relative.max(0.0) * at.length_m, 0.0]
    }
}

/// Effect `varying_wind_n_m`: a wind along x that blows from one side, in two waves.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("varying_wind_n_m", "wind of varying strength", "N/m", Hook::Force, log_uniform(1e-3, 2.0), 100.0),
        &[FREQUENCY],
        |magnitude, episode| episode.terms.forces.push(Arc::new(Wind(magnitude, episode.unlisted.frequency_hz))),
    )
}
