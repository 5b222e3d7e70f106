//! Files of a study: written whole or not at all, since several processes share the folder.

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
    // A random number, because two processes may make the same file, and those of two machines may have the same number.
    let unfinished = path.with_extension(format!("unfinished-{:016x}", rand::random::<u64>()));
    std::fs::write(&unfinished, bytes).with_context(named)?;
    std::fs::rename(&unfinished, path).with_context(named)
}

/// Value in a JSON file, which is made first if it is missing. It is read back in either case: a number may lose its last bit in the text,
/// and a study that goes on would differ from one that was never stopped.
pub fn kept<T: Serialize + DeserializeOwned>(path: &Path, make: impl FnOnce() -> Result<T>) -> Result<T> {
    if !path.exists() {
        write_json(path, &make()?)?;
    }
    read_json(path)
}

/// Writes a value as JSON.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<()> {
    write(path, &serde_json::to_vec(value)?)
}

/// Value in a JSON file.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = catenary_shell::files::read_text("study", path)?;
    serde_json::from_str(&text).with_context(|| format!("{}: remove it, and it is made again", path.display()))
}
