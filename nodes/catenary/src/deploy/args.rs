//! Arguments of `deploy`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary deploy`.
#[derive(Debug, Args)]
pub struct DeployArgs {
    /// Policy file (safetensors)
    #[arg(long)]
    pub policy: PathBuf,
    /// Continue to the step limit after the goal was reached
    #[arg(long)]
    pub run_all_steps: bool,
    /// Do not move to the start pose first
    #[arg(long)]
    pub from_here: bool,
    /// Deploy a policy that was trained for an arm of another law, too
    #[arg(long)]
    pub any_arm: bool,
    /// Seconds to wait for the graph
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true)]
    pub wait_s: f64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
