//! Arguments of `doctor`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Model (file or name) to check too
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
