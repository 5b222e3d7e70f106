//! The vectorised environment, as training sees it.

use crate::Observation;
use thiserror::Error;

/// Why an environment could not be stepped.
#[derive(Debug, Error)]
pub enum EnvError {
    /// The number of actions is not the number of environments, or an action is not finite.
    #[error("environment: {0}")]
    Input(String),
    /// The service behind the environment failed.
    #[error("environment: {0}")]
    Backend(String),
}

/// What one step of one environment gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// The observation to act on next: of the new episode where the old one ended.
    pub observation: Observation,
    /// Reward of the step.
    pub reward: f64,
    /// The episode reached its goal or left the workspace: its value ends here.
    pub terminated: bool,
    /// The episode reached its step limit: its value goes on, from `final_observation`.
    pub truncated: bool,
    /// The last observation of the episode that the step belongs to.
    pub final_observation: Observation,
}

/// N environments that step together; one whose episode ended is reset at once.
pub trait Env {
    /// N.
    fn count(&self) -> usize;
    /// Starts a new episode in every environment. Returns N observations.
    fn reset(&mut self) -> Result<Vec<Observation>, EnvError>;
    /// Steps every environment with its action (dx, dz) in m. Returns N transitions.
    fn step(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Transition>, EnvError>;
}
