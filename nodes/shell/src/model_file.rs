//! Model files: what a parameter `model_file` or an option `--model` names.

use anyhow::{Context, Result};
use catenary_core::{Model, ModelError};
use std::path::Path;

/// The model in the file at `path`, which `parse` reads: [`Model::from_yaml`], or a reader that knows the simulator's
/// parameters too. `what` says where the path came from, `model` or `model_file`.
///
/// # Errors
/// A file that cannot be read and a text that is no model: the message names the file, and line and field in it.
pub fn read_model(what: &str, path: &Path, parse: impl Fn(&str) -> Result<Model, ModelError>) -> Result<Model> {
    let named = || format!("{what} {}", path.display());
    let text = std::fs::read_to_string(path).with_context(named)?;
    parse(&text).with_context(named)
}
