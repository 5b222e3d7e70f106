//! Reading policy files.

use crate::wrong_input::Given;
use anyhow::{Context, Result};
use catenary_core::Policy;
use std::path::Path;

/// The policy in the file at `path`, with the file's bytes.
pub fn read(path: &Path) -> Result<(Policy, Vec<u8>)> {
    let bytes = catenary_shell::files::read_bytes("policy", path).given()?;
    let policy = Policy::from_bytes(&bytes).with_context(|| path.display().to_string()).given()?;
    Ok((policy, bytes))
}
