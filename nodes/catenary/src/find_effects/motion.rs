//! File with the motion that separates indistinguishable effects.

use super::optional;
use crate::inputs::actions_file;
use anyhow::Result;
use std::path::Path;

/// Name of the file.
const FILE: &str = "separating_motion.csv";

/// Writes the actions that separate indistinguishable effects; empty if there are none.
pub fn write(folder: &Path, of_steps: &[[f64; 2]]) -> Result<()> {
    let text = (!of_steps.is_empty()).then(|| actions_file::written(of_steps));
    optional::write(&folder.join(FILE), text)
}
