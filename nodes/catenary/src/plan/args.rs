//! Arguments of `plan`.

use crate::options::{ArmOption, Output, StartMovingOption, TaskOption, parameter_value};
use clap::Args;
use std::path::PathBuf;

/// `catenary plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// Task in place of the model's
    #[command(flatten)]
    pub task: TaskOption,
    /// Starts in motion
    #[command(flatten)]
    pub start: StartMovingOption,
    /// Arm in place of the model's
    #[command(flatten)]
    pub arm: ArmOption,
    /// posterior.json of the objects that the plan is for; default: the model's prior
    #[arg(long)]
    pub posterior: Option<PathBuf>,
    /// Value of an inferred parameter, as NAME=VALUE; all of them, in place of --posterior: the plan is for this object
    #[arg(long, value_parser = parameter_value, conflicts_with = "posterior")]
    pub theta: Vec<(String, f64)>,
    /// Policy file to write (safetensors); `train --plan` begins with it, and `deploy` runs it
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
