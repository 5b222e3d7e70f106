//! Arguments of `propose`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary propose`.
#[derive(Debug, Args)]
pub struct ProposeArgs {
    /// Model (file or name)
    #[arg(long)]
    pub model: PathBuf,
    /// posterior.json of an earlier recording, whose values are tried; default: the model's prior
    #[arg(long)]
    pub posterior: Option<PathBuf>,
    /// Folder for motion_1.csv and motion_2.csv, the paths of the hand
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Number of values of the parameters for which the motions are compared and checked
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub values: u16,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
