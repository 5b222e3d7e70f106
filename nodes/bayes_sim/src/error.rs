//! Why an inference gave no posterior.

use crate::embedding::InputError;
use crate::network::TrainingError;
use crate::sequential::StateError;
use catenary_core::SimulatorError;
use catenary_core::mixture::MixtureError;
use thiserror::Error;

/// Why an inference gave no posterior.
#[derive(Debug, Error)]
pub enum InferenceError {
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
    /// The measured track cannot be used.
    #[error("the measured {0}")]
    Observation(InputError),
    /// Nothing of the measured track lies in what the model's camera sees.
    #[error(
        "the measured track: expected keypoints within the view of the model's camera, got all {points} outside of it: the model and the recording are not one another's, or the track is not in metres"
    )]
    OutOfView {
        /// Keypoints of the track.
        points: usize,
    },
    /// The model asks for a drive that the caller did not give.
    #[error("the model drives the simulator by {drive}: expected {expected}, got none")]
    Drive {
        /// The model's drive.
        drive: &'static str,
        /// What is needed for it.
        expected: &'static str,
    },
    /// The state to go on from is not of this inference.
    #[error("the state of an earlier inference: {0}")]
    State(StateError),
    /// The simulator failed.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The simulator gave another number of tracks than it was asked for.
    #[error("simulator: expected {expected} tracks, got {got}")]
    TrackCount {
        /// Tracks asked for.
        expected: usize,
        /// Tracks that came.
        got: usize,
    },
    /// Too few usable tracks to train on.
    #[error("iteration {iteration}: expected at least {expected} usable tracks to train on, got {got}{because}")]
    TooFewTracks {
        /// Iteration, from 1.
        iteration: usize,
        /// Needed.
        expected: usize,
        /// Found.
        got: usize,
        /// Why the last track was refused, with a leading separator; empty where none was.
        because: String,
    },
    /// A network could not be trained.
    #[error("iteration {iteration}: {reason}")]
    Training {
        /// Iteration, from 1.
        iteration: usize,
        /// What happened.
        reason: TrainingError,
    },
    /// A network's mixture at the measured track is none, or lies outside the prior's support.
    #[error("iteration {iteration}: the posterior at the measured track is unusable: {reason}")]
    Posterior {
        /// Iteration, from 1.
        iteration: usize,
        /// What is wrong with it.
        reason: MixtureError,
    },
    /// The region that proposals are drawn from could not be sampled.
    #[error("iteration {iteration}: no draw in {draws} fell inside the region of the newest posterior")]
    EmptyRegion {
        /// Iteration, from 1.
        iteration: usize,
        /// Draws made.
        draws: usize,
    },
    /// The caller asked to stop.
    #[error("inference was cancelled after {simulations} simulations")]
    Cancelled {
        /// Simulations run so far.
        simulations: usize,
    },
}

// It words its cause itself; were it its source too, who prints a chain of causes would say it twice.
impl From<StateError> for InferenceError {
    fn from(error: StateError) -> Self {
        Self::State(error)
    }
}
