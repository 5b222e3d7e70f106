//! Arguments of `evaluate`.

use crate::options::{ArmOption, FidelityName, Output, ReportPage, StartMovingOption, TaskOption, parameter_value};
use clap::Args;
use std::path::PathBuf;

/// `catenary evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Policy file (safetensors); several run the same episodes and are compared with the first
    #[arg(long, required = true)]
    pub policy: Vec<PathBuf>,
    /// Model (file or name) of the simulated cell
    #[arg(long)]
    pub model: PathBuf,
    /// Task in place of the model's
    #[command(flatten)]
    pub task: TaskOption,
    /// Arm in place of the model's
    #[command(flatten)]
    pub arm: ArmOption,
    /// Starts in motion
    #[command(flatten)]
    pub start: StartMovingOption,
    /// posterior.json to draw the object's parameters from; default: the model's prior
    #[arg(long)]
    pub posterior: Option<PathBuf>,
    /// Value of an inferred parameter in every episode, as NAME=VALUE
    #[arg(long, value_parser = parameter_value)]
    pub theta: Vec<(String, f64)>,
    /// Value of another parameter in every episode, as NAME=VALUE; default: drawn from the model's distribution
    #[arg(long, value_parser = parameter_value)]
    pub effect: Vec<(String, f64)>,
    /// Leave out the best plan that a search finds for the same objects and scores beside the policies
    #[arg(long)]
    pub no_plan: bool,
    /// Episodes of each policy
    // At least 30 episodes: the intervals rest on the normal approximation.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(30..=100_000))]
    pub episodes: u64,
    /// Fidelity of the simulation
    #[arg(long, value_enum, default_value = "reference")]
    pub fidelity: FidelityName,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Page of the report
    #[command(flatten)]
    pub page: ReportPage,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
