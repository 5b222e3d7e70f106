//! Arguments of `find-effects`.

use crate::options::{Bags, OnGraph, Output};
use clap::Args;
use std::path::PathBuf;

/// `catenary find-effects`.
#[derive(Debug, Args)]
#[command(mut_arg("bags", |arg| arg.help("Bag (folder, .mcap or .db3 file) whose complete episodes are analysed; several may be given")))]
pub struct FindEffectsArgs {
    /// Bags whose complete episodes are analysed
    #[command(flatten)]
    pub bags: Bags,
    /// Bag of validation episodes, which no fit uses and which choose between models; several may be given; default: those
    /// of --verify, otherwise the last third of the episodes
    #[arg(long, conflicts_with = "node")]
    pub validate: Vec<PathBuf>,
    /// Bag of held-out episodes, which choose nothing and verify the result; several may be given. Without --validate they
    /// are the validation episodes, and the result says so
    #[arg(long)]
    pub verify: Vec<PathBuf>,
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// Folder for verdict.json, model.yaml and report/index.html; with --node for model.yaml alone
    #[arg(long)]
    pub out: PathBuf,
    /// Null data sets (simulated without a gap) that each test is compared with; with --node, a parameter of the node
    /// sets their number
    #[arg(long, default_value_t = 199, conflicts_with = "node")]
    pub null_sets: usize,
    /// Seed of every random draw; p-values of several searches are independent only if each search has its own seed
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Process that does the work
    #[command(flatten)]
    pub on_graph: OnGraph,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
