//! Errors of a search.

use catenary_core::{ModelError, SimulatorError};
use thiserror::Error;
use track_fit::FitError;

/// Error that ends a search without a verdict.
#[derive(Debug, Error)]
pub enum FinderError {
    /// Invalid setting.
    #[error("settings: `{field}`: expected {expected}, got {got}")]
    Setting {
        /// Field of the settings.
        field: &'static str,
        /// Expected values.
        expected: String,
        /// Value that came.
        got: String,
    },
    /// Empty list of measured episodes.
    #[error("expected at least one measured episode, got none")]
    NoEpisode,
    /// Episode that cannot be fitted with this model.
    #[error(transparent)]
    Episode(FitError),
    /// Effect name in the model file that the library does not know.
    #[error("model: lacking.{field}: expected effects of the library ({known}), got `{name}`{hint}")]
    UnknownEffect {
        /// Field of `lacking`.
        field: &'static str,
        /// Unknown name.
        name: String,
        /// Known names, separated by commas.
        known: String,
        /// Suggested name with a leading separator; empty if no known name is similar.
        hint: String,
    },
    /// Fit of which every start failed to simulate.
    #[error("no start of the fit could be simulated: {0}")]
    NoFit(String),
    /// Test with too few null data sets that could be simulated and fitted.
    #[error("expected {expected} null data sets, got {got} of {drawn} draws: {refusal}")]
    NullSets {
        /// Required number of null data sets.
        expected: usize,
        /// Number of null data sets that were fitted.
        got: usize,
        /// Number of null data sets that were drawn.
        drawn: usize,
        /// Reason of the last failure.
        refusal: String,
    },
    /// Error of the simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// Repaired model that is not a valid model.
    #[error("the repaired model: {0}")]
    Repair(ModelError),
    /// Search that the caller cancelled.
    #[error("the search was cancelled while it was to {0}")]
    Cancelled(&'static str),
}

// No `#[from]`: the message holds the cause already, and a printed chain of causes would repeat it.
impl From<ModelError> for FinderError {
    fn from(error: ModelError) -> Self {
        Self::Repair(error)
    }
}

// A search ends as its fits do, whether it was cancelled in a fit or between two.
impl From<FitError> for FinderError {
    fn from(error: FitError) -> Self {
        match error {
            FitError::NoFit(reason) => Self::NoFit(reason),
            FitError::Simulator(error) => Self::Simulator(error),
            FitError::Cancelled => Self::Cancelled("fit"),
            FitError::Drive { .. } | FitError::Nothing { .. } | FitError::Noise { .. } | FitError::PoseNoise { .. } => {
                Self::Episode(error)
            }
        }
    }
}

impl FinderError {
    /// Error of a fit whose Gauss-Newton matrix is not positive definite, so that it has no Laplace posterior.
    pub(crate) fn curvature() -> Self {
        Self::NoFit("the fit's curvature is no positive matrix".into())
    }
}
