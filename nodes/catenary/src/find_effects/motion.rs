//! File with the motion that separates indistinguishable effects.

use crate::inputs::actions_file;
use anyhow::{Context, Result};
use catenary_shell::files;
use std::path::Path;

/// Name of the file.
const FILE: &str = "separating_motion.csv";

/// Writes the actions that separate indistinguishable effects. A file of an earlier search is replaced, or removed if
/// there are none.
pub fn write(folder: &Path, of_steps: &[[f64; 2]]) -> Result<()> {
    let path = folder.join(FILE);
    if !of_steps.is_empty() {
        return files::write(&path, actions_file::written(of_steps));
    }
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| path.display().to_string())
        }
        _ => Ok(()),
    }
}
