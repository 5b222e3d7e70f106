//! Vectorised environment: the interface through which training reaches a simulator.

use crate::Observation;
use thiserror::Error;

/// Failure to step an environment.
#[derive(Debug, Error)]
pub enum EnvError {
    /// The number of actions is not the number of environments, or an action is not finite.
    #[error("environment: {0}")]
    Input(String),
    /// The service behind the environment failed.
    #[error("environment: {0}")]
    Backend(String),
}

/// Result of one step of one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// Observation to act on next. After the end of an episode it is the first of the new episode.
    pub observation: Observation,
    /// Reward of the step.
    pub reward: f64,
    /// True if the episode reached its goal or left the workspace. No value is bootstrapped after it.
    pub terminated: bool,
    /// True if the episode reached its step limit. Its value is bootstrapped from `final_observation`.
    pub truncated: bool,
    /// Last observation of the episode that the step belongs to.
    pub final_observation: Observation,
}

/// N environments that step together. An environment whose episode ended is reset in the same step.
pub trait Env {
    /// Number N of environments.
    fn count(&self) -> usize;
    /// Starts a new episode in every environment. Returns N observations.
    fn reset(&mut self) -> Result<Vec<Observation>, EnvError>;
    /// Steps every environment with its action (dx, dz) in m. Returns N transitions in the order of the actions.
    fn step(&mut self, actions: &[[f64; 2]]) -> Result<Vec<Transition>, EnvError>;
}
