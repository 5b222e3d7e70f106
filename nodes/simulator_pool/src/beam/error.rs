//! Why a beam was refused.

use thiserror::Error;

/// Why a beam was refused.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum BeamError {
    /// A parameter outside the range in which the beam is defined.
    #[error("beam: {name}: expected {expected}, got {got}")]
    Parameter {
        /// Name of the field, with its unit.
        name: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What came.
        got: f64,
    },
    /// Another number of elements than the beam's memory was made for.
    #[error("beam: made for {expected} elements, got {got}")]
    Elements {
        /// What the memory was made for.
        expected: usize,
        /// What came.
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
