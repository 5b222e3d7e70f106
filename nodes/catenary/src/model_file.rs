//! Reading model files.

use anyhow::{Context, Result};
use catenary_core::Model;
use std::path::Path;

/// The soft bar, carried inside the program.
pub const SOFT_BAR: &str = include_str!("../../../launch_configs/models/soft_bar.yaml");

/// The model in the file at `path`, its physical parameters checked too.
pub fn read(path: &Path) -> Result<Model> {
    let text = std::fs::read_to_string(path).with_context(|| format!("model {}", path.display()))?;
    parse(&text).with_context(|| path.display().to_string())
}

/// The model in the file at `path`, or the soft bar.
pub fn read_or_soft_bar(path: Option<&Path>) -> Result<Model> {
    path.map_or_else(|| parse(SOFT_BAR), read)
}

fn parse(text: &str) -> Result<Model> {
    let model = Model::from_yaml(text)?;
    simulator_pool::parameters::check(&model)?;
    Ok(model)
}
