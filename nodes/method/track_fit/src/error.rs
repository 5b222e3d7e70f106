//! Errors of a fit.

use catenary_core::SimulatorError;
use thiserror::Error;

/// Error that ends a fit without a result.
#[derive(Debug, Error)]
pub enum FitError {
    /// Episode without the actions that the model's drive needs.
    #[error("{episode}: the model drives the simulator by {drive}: expected the episode's actions, got none")]
    Drive {
        /// Name of the episode.
        episode: String,
        /// Drive of the model.
        drive: &'static str,
    },
    /// Episode without the wrench, for a model that compares nothing else.
    #[error(
        "{episode}: the model leaves the keypoints out (observation.keypoints: false): expected the wrench of the episode, got none"
    )]
    Nothing {
        /// Name of the episode.
        episode: String,
    },
    /// Camera without keypoint noise: residuals have no unit in which they could be tested.
    #[error("model: camera.keypoint_noise_px: expected more than 0, the unit of the residuals, got {got}")]
    Noise {
        /// Value of the model file, px.
        got: f64,
    },
    /// Predicted arm without pose noise: its residuals have no unit in which they could be tested.
    #[error("model: arm.pose_noise_m: expected more than 0, the unit of the arm's residuals, got {got}")]
    PoseNoise {
        /// Value of the model file, m.
        got: f64,
    },
    /// Fit of which every start failed to simulate.
    #[error("no start of the fit could be simulated: {0}")]
    NoFit(String),
    /// Error of the simulator.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// Fit that the caller cancelled.
    #[error("the fit was cancelled")]
    Cancelled,
}
