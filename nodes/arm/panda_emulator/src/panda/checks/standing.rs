//! Errors that a recovery leaves standing: a load or a frame that does not fit the arm, a hand that still pushes.
//!
//! An idle arm answers to errors that begin. If it answered to those that stand, too, it would fall back into the reflex before its
//! client could set what is wrong, since setters are refused in a reflex. A motion ends for every error.

use crate::fci::Errors;

/// Cycles after a recovery whose errors count as standing. Chosen: a value at its threshold, with noise, shows within them.
const FRESH_CYCLES: u32 = 100;
/// Cycles without any standing error after which all are forgotten. Chosen: likewise.
const QUIET_CYCLES: u32 = 100;

/// Errors that stood after the last recovery.
#[derive(Debug, Clone, Copy, Default)]
pub struct Standing {
    errors: Errors,
    fresh_cycles: u32,
    quiet_cycles: u32,
}

impl Standing {
    /// Begins anew after a recovery.
    pub fn recovered(&mut self) {
        *self = Self { fresh_cycles: FRESH_CYCLES, ..Self::default() };
    }

    /// Takes the errors of a cycle and returns those of them that did not stand after the recovery.
    pub fn begun(&mut self, errors: Errors) -> Errors {
        if self.fresh_cycles > 0 {
            self.fresh_cycles -= 1;
            self.errors = self.errors.union(errors);
        }
        let begun = errors.without(self.errors);
        let quiet = errors == begun;
        self.quiet_cycles = if quiet { self.quiet_cycles + 1 } else { 0 };
        if self.quiet_cycles > QUIET_CYCLES {
            *self = Self { fresh_cycles: self.fresh_cycles, ..Self::default() };
        }
        begun
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fci::ErrorKind;

    #[test]
    fn standing_errors_are_known_until_they_have_gone_for_a_while() {
        let (push, fast) = (Errors::of(ErrorKind::CartesianReflex), Errors::of(ErrorKind::JointVelocityViolation));
        let mut standing = Standing::default();
        assert_eq!(standing.begun(push), push, "without a recovery every error begins");
        standing.recovered();
        for k in 0..FRESH_CYCLES + 50 {
            // At its threshold a value comes and goes.
            let errors = if k % 3 == 0 { push } else { Errors::default() };
            assert!(standing.begun(errors).is_empty());
        }
        assert_eq!(standing.begun(push.union(fast)), fast);
        for _ in 0..=QUIET_CYCLES {
            assert!(standing.begun(Errors::default()).is_empty());
        }
        assert_eq!(standing.begun(push), push);
    }
}
