//! Backward differences of first and second order.

use super::discretisation::Scheme;

/// Backward difference: the rate of y is `c0` y(now) + `c1` y(one step ago) + `c2` y(two steps ago).
#[derive(Debug, Clone, Copy)]
pub(super) struct BackwardDifference {
    pub c0: f64,
    pub c1: f64,
    pub c2: f64,
}

impl BackwardDifference {
    pub fn new(scheme: Scheme, step_s: f64) -> Self {
        match scheme {
            Scheme::ImplicitEuler => Self { c0: 1.0 / step_s, c1: -1.0 / step_s, c2: 0.0 },
            Scheme::Bdf2 => Self { c0: 1.5 / step_s, c1: -2.0 / step_s, c2: 0.5 / step_s },
        }
    }

    /// Part of the rate that the past fixes.
    #[inline(always)]
    pub fn history<const N: usize>(&self, one_ago: &[f64; N], two_ago: &[f64; N]) -> [f64; N] {
        let mut history = [0.0; N];
        for i in 0..N {
            history[i] = self.c1 * one_ago[i] + self.c2 * two_ago[i];
        }
        history
    }
}
