//! Option `--json`.

use clap::Args;

/// Machine-readable output.
#[derive(Debug, Args)]
pub struct Output {
    /// Print the result as JSON on stdout
    #[arg(long)]
    pub json: bool,
}
