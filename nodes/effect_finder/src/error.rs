//! Why there is no verdict.

use catenary_core::{ModelError, SimulatorError};
use thiserror::Error;

/// Why there is no verdict.
#[derive(Debug, Error)]
pub enum FinderError {
    /// A setting that makes no sense.
    #[error("settings: `{field}`: expected {expected}, got {got}")]
    Setting {
        /// The field.
        field: &'static str,
        /// What was expected.
        expected: String,
        /// What came.
        got: String,
    },
    /// Nothing to look at.
    #[error("expected at least one measured episode, got none")]
    NoEpisode,
    /// An episode that the model cannot be driven by.
    #[error("episode {episode}: the model drives the simulator by {drive}: expected the episode's actions, got none")]
    Drive {
        /// Place of the episode, from 0.
        episode: usize,
        /// The model's drive.
        drive: &'static str,
    },
    /// A camera without noise, by which nothing can be said to be more than noise.
    #[error("model: camera.keypoint_noise_px: expected more than 0, by which a disagreement is measured, got {got}")]
    Noise {
        /// The value.
        got: f64,
    },
    /// An arm without noise, whose path is a prediction.
    #[error("model: arm.pose_noise_m: expected more than 0, by which a disagreement of the arm is measured, got {got}")]
    PoseNoise {
        /// The value.
        got: f64,
    },
    /// The model speaks of an effect that there is not.
    #[error("model: lacking.{field}: expected effects of the library, {known}; got `{name}`{hint}")]
    UnknownEffect {
        /// The field.
        field: &'static str,
        /// What it names.
        name: String,
        /// The effects that there are.
        known: String,
        /// The effect that may have been meant, with a leading separator; empty where none is near.
        hint: String,
    },
    /// The simulator failed at every start of a fit.
    #[error("no start of the fit could be simulated: {0}")]
    NoFit(String),
    /// Too few data sets without a gap could be simulated and fitted.
    #[error("expected {expected} data sets without a gap to test against, got {got} of {drawn}: {refusal}")]
    NullSets {
        /// How many were wanted.
        expected: usize,
        /// How many there are.
        got: usize,
        /// How many were drawn for that.
        drawn: usize,
        /// Why the last one was not to be had.
        refusal: String,
    },
    /// The simulator failed.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The repaired model is none.
    #[error("the repaired model: {0}")]
    Repair(ModelError),
    /// The caller asked to stop.
    #[error("the search was cancelled while it was to {0}")]
    Cancelled(&'static str),
}

// It words its cause itself; were it its source too, who prints a chain of causes would say it twice.
impl From<ModelError> for FinderError {
    fn from(error: ModelError) -> Self {
        Self::Repair(error)
    }
}

impl FinderError {
    /// That a fit has no posterior, as what it rests on is no positive matrix.
    pub(crate) fn curvature() -> Self {
        Self::NoFit("the fit's curvature is no positive matrix".into())
    }
}
