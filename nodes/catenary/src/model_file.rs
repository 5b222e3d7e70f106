//! Reading model files.

use anyhow::Result;
use catenary_core::Model;
use simulator_pool::model_text;
use std::path::Path;

/// The soft bar, carried inside the program.
pub const SOFT_BAR: &str = include_str!("../../../launch_configs/models/soft_bar.yaml");

/// The model in the file at `path`, its physical parameters checked too.
pub fn read(path: &Path) -> Result<Model> {
    catenary_shell::read_model("model", path, model_text::read)
}

/// The model in the file at `path`, or the soft bar.
pub fn read_or_soft_bar(path: Option<&Path>) -> Result<Model> {
    path.map_or_else(|| Ok(model_text::read(SOFT_BAR)?), read)
}
