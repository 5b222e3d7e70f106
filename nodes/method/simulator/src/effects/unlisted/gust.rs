//! A gust of wind.

use super::super::effect::{Hook, log_uniform};
use super::super::term_effect::TermEffect;
use super::about;
use crate::beam::{ForceTerm, PointState};
use std::sync::Arc;

/// Time of the gust in s since the start.
const GUST_S: std::ops::Range<f64> = 1.5..3.0;

/// Force in N/m.
struct Wind(f64);

impl ForceTerm for Wind {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        if GUST_S.contains(&at.time_s) { [self.0 * at.length_m, 0.0] } else { [0.0; 2] }
    }
}

/// Effect `gust_n_m`: a wind along x that blows for 1.5 s.
pub fn effect() -> TermEffect {
    TermEffect::new(
        about("gust_n_m", "gust of wind", "N/m", Hook::Force, log_uniform(1e-3, 2.0), 100.0),
        &[],
        |magnitude, episode| episode.terms.forces.push(Arc::new(Wind(magnitude))),
    )
}
