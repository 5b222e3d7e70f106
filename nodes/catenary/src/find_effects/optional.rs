//! Files that not every search has.

use anyhow::{Context, Result};
use catenary_shell::files;
use std::path::Path;

/// Model with the effects nearest to what is missing, where there are such.
pub const NEAREST: &str = "nearest.yaml";

/// Writes the file. One of an earlier search is replaced, or removed if this search has none.
pub fn write(path: &Path, text: Option<String>) -> Result<()> {
    if let Some(text) = text {
        return files::write(path, text);
    }
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| path.display().to_string())
        }
        _ => Ok(()),
    }
}
