//! Arguments of `import-track`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary import-track`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// Track: t_s, grip_x_m, grip_z_m, grip_pitch_rad, p1_x_m .. p4_z_m, and optionally the wrench
    pub track: PathBuf,
    /// Model (file or name), for its camera
    #[arg(long)]
    pub model: PathBuf,
    /// Folder of the bag to make
    #[arg(long)]
    pub out: PathBuf,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
