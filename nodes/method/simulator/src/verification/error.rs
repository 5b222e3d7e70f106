//! Errors of the verification.

use crate::beam::BeamError;
use crate::parameters::ParameterError;
use catenary_core::simulator::SimulatorError;
use thiserror::Error;

/// Error of a comparison that could not be made.
#[derive(Debug, Error, PartialEq)]
pub enum VerificationError {
    /// Beam that was refused.
    #[error(transparent)]
    Beam(#[from] BeamError),
    /// Model that was refused.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// Shape at rest that was not found.
    #[error("verification: expected a beam at rest, but its nodes still moved by {last_move_m} m")]
    NotAtRest {
        /// Largest movement of a node in the last round.
        last_move_m: f64,
    },
    /// Missing frequency, in theory or simulation.
    #[error("verification: expected a vibration, found none in the frequencies searched")]
    NoFrequency,
    /// Track that was refused.
    #[error("verification: {0}")]
    Track(String),
    /// Missing task.
    #[error("verification: model `{0}` has no task")]
    NoTask(String),
}

impl From<SimulatorError> for VerificationError {
    fn from(error: SimulatorError) -> Self {
        VerificationError::Track(error.to_string())
    }
}
