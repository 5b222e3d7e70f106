//! Arguments of `launch` and `status`.

use crate::options::Output;
use clap::Args;
use std::path::PathBuf;

/// `catenary launch`.
#[derive(Debug, Args)]
pub struct LaunchArgs {
    /// Launch file in ROS 2's XML form
    pub file: PathBuf,
    /// Arguments of the launch file, as NAME:=VALUE
    pub arguments: Vec<String>,
    /// Show the file's arguments and processes, and start nothing
    #[arg(long)]
    pub show: bool,
    /// Folder for the processes' output; default: a new one in ROS 2's log folder, ROS_LOG_DIR or ~/.ros/log
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Machine-readable output, of --show or of the end of the launch
    #[command(flatten)]
    pub output: Output,
}

/// `catenary status`.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Log folder of the launch; default: the newest launch
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
