//! Arguments of `demo` and `report`.

use crate::options::Output;
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Robot cell of a demo.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DemoCell {
    /// Arm with a lag and a speed limit, without forces
    #[default]
    Sim,
    /// Emulated Panda that the bridge drives by torques, as it drives a real one
    Emulated,
}

/// `catenary demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for the bags, policies, posterior and report
    #[arg(long, default_value = "demo")]
    pub out: PathBuf,
    /// Use the sizes of the paper: hours instead of minutes
    #[arg(long)]
    pub paper: bool,
    /// Robot cell
    #[arg(long, value_enum, default_value_t)]
    pub cell: DemoCell,
    /// Seed of every random draw, including the hidden parameters
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}

/// `catenary report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder that a demo wrote
    #[arg(long, default_value = "demo")]
    pub dir: PathBuf,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
