//! Policy files.

use crate::exit::Given;
use anyhow::{Context, Result};
use catenary_core::Policy;
use std::path::Path;

/// Size limit of a policy file, bytes. The default network takes 22 kB.
const MOST_BYTES: u64 = 64 << 20;

/// Policy in the file at `path`, and the bytes of the file.
pub fn read(path: &Path) -> Result<(Policy, Vec<u8>)> {
    let bytes = catenary_shell::files::read_at_most("policy", path, MOST_BYTES).given()?;
    let policy = Policy::from_bytes(&bytes).with_context(|| path.display().to_string()).given()?;
    Ok((policy, bytes))
}
