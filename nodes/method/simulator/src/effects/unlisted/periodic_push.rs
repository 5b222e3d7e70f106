//! A push that repeats.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::{FREQUENCY, PLACE, about};
use crate::beam::{ForceTerm, PointState};
use crate::episode_model::Companions;
use std::sync::Arc;

/// Share of each period for which the push lasts.
const LASTS: f64 = 0.2;

/// Force in N/m, with place and frequency.
struct Push(f64, Companions);

impl ForceTerm for Push {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        // The first push comes after most of a period, so that the object begins at rest.
        let part = (at.time_s * self.1.frequency_hz).fract();
        if part > 1.0 - LASTS && at.fraction >= self.1.place { [self.0 * at.length_m, 0.0] } else { [0.0; 2] }
    }
}

/// Effect `periodic_push_n_m`: something pushes the part beyond a place along x, for a fifth of each period.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("periodic_push_n_m", "periodic push", "N/m", Hook::Force, log_uniform(1e-3, 4.0), 100.0),
        &[PLACE, FREQUENCY],
        |magnitude, episode| episode.terms.forces.push(Arc::new(Push(magnitude, episode.unlisted))),
    )
}
