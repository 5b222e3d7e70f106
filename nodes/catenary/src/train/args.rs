//! Arguments of `train`.

use crate::options::{
    ArmOption, ObservesOptions, OnGraph, Output, ReportPage, StartMovingOption, TaskOption, TrainingPreset,
    parameter_value,
};
use clap::Args;
use std::path::PathBuf;

/// `catenary train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// Task in place of the model's
    #[command(flatten)]
    pub task: TaskOption,
    /// posterior.json to train over; default: the model's prior
    #[arg(long)]
    pub posterior: Option<PathBuf>,
    /// Value of an inferred parameter in every episode, as NAME=VALUE; all of them, in place of --posterior
    #[arg(long, value_parser = parameter_value, conflicts_with = "posterior")]
    pub theta: Vec<(String, f64)>,
    /// Policy file to write (safetensors)
    #[arg(long)]
    pub out: PathBuf,
    /// Go on with the training that Ctrl-C ended, from its state in OUT.state; the other options must be the same, and the policy then is that of a
    /// training that was not interrupted, to the bit. Also goes on with a training that ended with a flat return, up to the most steps
    #[arg(long, conflicts_with = "node")]
    pub resume: bool,
    /// Most environment steps; default: the preset's. A training of the default preset ends earlier when its mean return has stopped rising
    #[arg(long)]
    pub steps: Option<u64>,
    /// What the policy observes
    #[command(flatten)]
    pub observes: ObservesOptions,
    /// Policy of the plan that the training begins with, from `catenary plan`; default: it is searched, for a preset that begins with one
    #[arg(long)]
    pub plan: Option<PathBuf>,
    /// Begin without a plan
    #[arg(long, conflicts_with = "plan")]
    pub no_plan: bool,
    /// Preset hyperparameters
    #[arg(long, value_enum, default_value = "default")]
    pub preset: TrainingPreset,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Arm in place of the model's
    #[command(flatten)]
    pub arm: ArmOption,
    /// Starts in motion
    #[command(flatten)]
    pub start: StartMovingOption,
    /// Process that does the work
    #[command(flatten)]
    pub on_graph: OnGraph,
    /// Page of the report
    #[command(flatten)]
    pub page: ReportPage,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
