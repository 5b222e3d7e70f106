//! Model files, named by a parameter `model_file` or an option `--model`.

use super::files;
use anyhow::{Context, Result};
use catenary_core::{Model, ModelError};
use std::path::Path;

/// Reads the model in the file at `path` with `parse`: [`Model::from_yaml`], or a parser that also knows the simulator's
/// parameters. `what` is the origin of the path, `model` or `model_file`.
///
/// # Errors
/// A file that cannot be read, or a text that is not a model. The message names the file, line and field.
pub fn read_model(what: &str, path: &Path, parse: impl Fn(&str) -> Result<Model, ModelError>) -> Result<Model> {
    parse(&files::read_text(what, path)?).with_context(|| format!("{what} {}", path.display()))
}
