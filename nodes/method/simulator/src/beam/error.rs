//! Errors of the beam's constructors.

use thiserror::Error;

/// Error of a beam that cannot be made.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum BeamError {
    /// Parameter outside the range in which the beam is defined.
    #[error("beam: {name}: expected {expected}, got {got}")]
    Parameter {
        /// Name of the field, with unit.
        name: &'static str,
        /// Allowed values.
        expected: &'static str,
        /// Given value.
        got: f64,
    },
    /// Number of elements that differs from the beam's memory.
    #[error("beam: made for {expected} elements, got {got}")]
    Elements {
        /// Number of elements that the memory holds.
        expected: usize,
        /// Given number of elements.
        got: usize,
    },
}

/// Checks that `value` is finite and satisfies `holds`.
pub(super) fn require(
    name: &'static str,
    expected: &'static str,
    got: f64,
    holds: impl Fn(f64) -> bool,
) -> Result<(), BeamError> {
    if got.is_finite() && holds(got) { Ok(()) } else { Err(BeamError::Parameter { name, expected, got }) }
}
