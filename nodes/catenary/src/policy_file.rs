//! Reading policy files.

use anyhow::{Context, Result};
use catenary_core::Policy;
use std::path::Path;

/// The policy in the file at `path`, with the file's bytes.
pub fn read(path: &Path) -> Result<(Policy, Vec<u8>)> {
    let bytes = std::fs::read(path).with_context(|| format!("policy {}", path.display()))?;
    let policy = Policy::from_bytes(&bytes).with_context(|| path.display().to_string())?;
    Ok((policy, bytes))
}
