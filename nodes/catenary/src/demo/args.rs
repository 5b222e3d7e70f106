//! Arguments of `demo` and `report`.

use crate::graph::own::Cell;
use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

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
    pub cell: Cell,
    /// Seed of every random draw, including the hidden parameters; the bar of the default needs a policy of its own
    #[arg(long, default_value_t = 5)]
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
