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
    /// Address of a real arm: check its network too, and warn of what its control at 1 kHz lacks
    #[arg(long, value_name = "ADDRESS")]
    pub robot: Option<String>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
