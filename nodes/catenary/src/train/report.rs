//! Result of a training.

use serde::Serialize;
use std::path::PathBuf;

/// Result of a training.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Path of the policy file.
    pub policy: PathBuf,
    /// Environment steps taken.
    pub steps: u64,
    /// True if Ctrl-C ended the training early.
    pub interrupted: bool,
    /// Mean return of the last episodes.
    pub mean_return: f64,
    /// Success rate of the last episodes.
    pub success_rate: f64,
    /// Environment steps per second.
    pub steps_per_second: f64,
    /// Learning curve: environment steps and mean return.
    pub curve: Vec<(u64, f64)>,
}

impl Report {
    /// Report in a line.
    pub fn words(&self) -> String {
        format!(
            "{}: {} steps, mean return {:.3}, success {:.0} %, {:.0} steps/s",
            self.policy.display(),
            self.steps,
            self.mean_return,
            100.0 * self.success_rate,
            self.steps_per_second
        )
    }
}
