//! Errors of an inference.

use crate::embedding::InputError;
use crate::network::TrainingError;
use crate::settings::SettingsError;
use catenary_core::SimulatorError;
use catenary_core::mixture::MixtureError;
use thiserror::Error;

/// Reason for which an inference gave no posterior.
#[derive(Debug, Error)]
pub enum InferenceError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingsError),
    /// The measured track cannot be used.
    #[error("the measured {0}")]
    Observation(InputError),
    /// Every keypoint of the measured track lies outside of the view of the model's camera.
    #[error(
        "the measured track: expected keypoints within the view of the model's camera, got all {points} outside of it: check that the model belongs to the recording and that the track is in metres"
    )]
    OutOfView {
        /// Number of keypoints of the track.
        points: usize,
    },
    /// The caller did not give the drive that the model needs.
    #[error("the model drives the simulator by {drive}: expected {expected}, got none")]
    Drive {
        /// Drive of the model.
        drive: &'static str,
        /// Data that the drive needs.
        expected: &'static str,
    },
    /// The saved state belongs to another inference or is damaged.
    #[error("the state of an earlier inference: {0}")]
    State(StateError),
    /// The simulator failed.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The simulator returned a wrong number of tracks.
    #[error("simulator: expected {expected} tracks, got {got}")]
    TrackCount {
        /// Number of tracks requested.
        expected: usize,
        /// Number of tracks received.
        got: usize,
    },
    /// Too few usable tracks for a training.
    #[error("iteration {iteration}: expected at least {expected} usable tracks to train on, got {got}{because}")]
    TooFewTracks {
        /// Iteration, from 1.
        iteration: usize,
        /// Least number of tracks.
        expected: usize,
        /// Number of usable tracks.
        got: usize,
        /// Reason for which the last track was refused, with a leading separator; empty if none was refused.
        because: String,
    },
    /// The training of a network failed.
    #[error("iteration {iteration}: {reason}")]
    Training {
        /// Iteration, from 1.
        iteration: usize,
        /// Cause.
        reason: TrainingError,
    },
    /// The networks' output at the measured track is no valid mixture, or the mixture lies outside of the prior's support.
    #[error(
        "iteration {iteration}: the posterior at the measured track is unusable: {reason}: do the model's priors and its effects fit the recording?"
    )]
    Posterior {
        /// Iteration, from 1.
        iteration: usize,
        /// Defect of the mixture.
        reason: MixtureError,
    },
    /// The region of the proposal is too thin to be sampled.
    #[error("iteration {iteration}: no draw in {draws} fell inside the region of the newest posterior")]
    EmptyRegion {
        /// Iteration, from 1.
        iteration: usize,
        /// Number of draws made.
        draws: usize,
    },
    /// The recording to predict is one of the recordings of the inference.
    #[error("{episode}: expected a recording that the inference does not see, got one of its recordings")]
    Seen {
        /// Name of the episode.
        episode: String,
    },
    /// A recording could not be compared with its prediction.
    #[error("the recording was not compared with its prediction: {reason}")]
    Unpredicted {
        /// Cause.
        reason: &'static str,
    },
    /// The caller stopped the inference.
    #[error("inference was cancelled after {simulations} simulations")]
    Cancelled {
        /// Simulations run so far.
        simulations: usize,
    },
}

// Written by hand instead of `#[from]`: that would make the cause a source, too, and printing a chain of causes would
// repeat it.
impl From<StateError> for InferenceError {
    fn from(error: StateError) -> Self {
        Self::State(error)
    }
}

/// Reason for which an inference cannot continue from a state.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum StateError {
    /// The state belongs to another inference.
    #[error("it belongs to another model, recording, setting or program")]
    Other,
    /// The parts of the state do not fit together.
    #[error("{what}: expected {expected}, got {got}")]
    Broken {
        /// Name of the part.
        what: &'static str,
        /// Expected contents.
        expected: String,
        /// Contents found.
        got: String,
    },
}
