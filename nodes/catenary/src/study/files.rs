//! Files of a study: written whole or not at all, since several processes share the folder.

use crate::exit::Given;
use anyhow::{Context, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// Writes a file. Another process sees the old state or all of it.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let named = || path.display().to_string();
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).with_context(named)?;
    }
    catenary_shell::files::write(path, bytes)
}

/// Value in a JSON file, which is made first if it is missing. It is read back in either case: a number may lose its last bit in the text,
/// and a study that goes on would differ from one that was never stopped. `check` refuses a value that is no part of the study.
pub fn kept<T: Serialize + DeserializeOwned>(
    path: &Path,
    check: impl FnOnce(&T) -> Result<()>,
    make: impl FnOnce() -> Result<T>,
) -> Result<T> {
    if !path.exists() {
        write_json(path, &make()?)?;
    }
    read_json(path, check)
}

/// Writes a value as JSON.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    write(path, &serde_json::to_vec(value)?)
}

/// Value in a JSON file that `check` accepts.
pub fn read_json<T: DeserializeOwned>(path: &Path, check: impl FnOnce(&T) -> Result<()>) -> Result<T> {
    let parse = || {
        let value = serde_json::from_slice(&catenary_shell::files::read_bytes("study", path)?)?;
        check(&value).map(|()| value)
    };
    parse().with_context(|| format!("{}: remove it, and it is made again", path.display())).given()
}
