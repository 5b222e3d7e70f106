//! Model files: what a parameter `model_file` or an option `--model` names.

use crate::files;
use anyhow::{Context, Result};
use catenary_core::{Model, ModelError};
use std::path::Path;

/// The model in the file at `path`, which `parse` reads: [`Model::from_yaml`], or a reader that knows the simulator's
/// parameters too. `what` says where the path came from, `model` or `model_file`.
///
/// # Errors
/// A file that cannot be read and a text that is no model: the message names the file, and line and field in it.
pub fn read_model(what: &str, path: &Path, parse: impl Fn(&str) -> Result<Model, ModelError>) -> Result<Model> {
    parse(&files::read_text(what, path)?).with_context(|| format!("{what} {}", path.display()))
}
