//! Arguments of `install`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary install`.
#[derive(Debug, Args)]
pub struct InstallArgs {
    /// Folder to install into
    #[arg(long)]
    pub prefix: PathBuf,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
