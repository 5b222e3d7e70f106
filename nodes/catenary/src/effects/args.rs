//! Arguments of `effects`.

use crate::options::{Output, parameter_value};
use clap::Args;
use std::path::PathBuf;

/// `catenary effects`.
#[derive(Debug, Args)]
pub struct EffectsArgs {
    /// Name of an effect to list; several may be given; default: all
    #[arg(long)]
    pub name: Vec<String>,
    /// Model (file or name): show the smallest size of each effect that is detectable in an episode of it
    #[arg(long, requires = "actions")]
    pub model: Option<PathBuf>,
    /// Actions of that episode: a CSV file with the columns dx_m, dz_m, one row per step
    #[arg(long, requires = "model")]
    pub actions: Option<PathBuf>,
    /// Value of a parameter or effect in that episode, or of a place or frequency that an effect needs, as NAME=VALUE;
    /// default: the model's nominal value, else the median of its distribution
    #[arg(long, requires = "model", value_parser = parameter_value)]
    pub value: Vec<(String, f64)>,
    /// Machine-readable output
    #[command(flatten)]
    pub output: Output,
}
