//! Files that the user names: reading them, and suggestions for a path that does not exist.

use anyhow::{Context, Result, anyhow};
use catenary_core::spelling::nearest;
use std::io::Error;
use std::path::{Component, Path, PathBuf};

/// Maximum number of names in a folder that are compared with a misspelt one.
const MOST_NAMES: usize = 10_000;

/// Reads the text of the file at `path`. `what` names its role, for example `model`.
///
/// # Errors
/// Message of the form `WHAT PATH: REASON`, with the nearest existing path.
pub fn read_text(what: &str, path: &Path) -> Result<String> {
    std::fs::read_to_string(path).map_err(|error| explained(path, error)).with_context(|| named(what, path))
}

/// Reads the bytes of the file at `path`.
///
/// # Errors
/// As [`read_text`].
pub fn read_bytes(what: &str, path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|error| explained(path, error)).with_context(|| named(what, path))
}

fn named(what: &str, path: &Path) -> String {
    format!("{what} {}", path.display())
}

fn explained(path: &Path, error: Error) -> anyhow::Error {
    match hint(path) {
        hint if hint.is_empty() => error.into(),
        hint => anyhow!("{error}{hint}"),
    }
}

/// Returns the end of a message about a path that does not exist: `; did you mean ...?`. Empty if the path exists or has no near
/// neighbour.
pub fn hint(path: &Path) -> String {
    similar(path).map_or_else(String::new, |path| format!("; did you mean `{}`?", path.display()))
}

/// Returns an existing path that differs from `path` only in the first missing component.
fn similar(path: &Path) -> Option<PathBuf> {
    // A file that exists and cannot be read has another fault than its name.
    if path.as_os_str().is_empty() || path.exists() {
        return None;
    }
    let mut folder = PathBuf::new();
    let mut parts = path.components();
    let missing = loop {
        let part = parts.next()?;
        let next = folder.join(part);
        if !next.exists() {
            break part;
        }
        folder = next;
    };
    let Component::Normal(missing) = missing else { return None };
    let shown = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
    let names = std::fs::read_dir(shown).ok()?.flatten().take(MOST_NAMES);
    let rest = parts.as_path();
    let whole = |name: &str| match rest.as_os_str().is_empty() {
        true => folder.join(name),
        false => folder.join(name).join(rest),
    };
    let mut names: Vec<String> = names.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.retain(|name| whole(name).exists());
    // Folders list their files in arbitrary order. Sorted, the same mistake gets the same answer.
    names.sort();
    nearest(missing.to_str()?, names.iter().map(String::as_str)).map(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_path_suggests_its_nearest_neighbour() {
        let folder = std::env::temp_dir().join(format!("catenary_files_{}", std::process::id()));
        std::fs::create_dir_all(folder.join("models")).unwrap();
        std::fs::write(folder.join("models/soft_bar.yaml"), "text").unwrap();
        std::fs::write(folder.join("notes"), "").unwrap();
        let right = folder.join("models/soft_bar.yaml").display().to_string();
        for wrong in ["models/softbar.yaml", "model/soft_bar.yaml", "models/soft_bar"] {
            assert_eq!(hint(&folder.join(wrong)), format!("; did you mean `{right}`?"), "{wrong}");
        }
        for none in ["models/soft_bar.yaml", "models/x", "wrong/soft_bar.yaml", "note/soft_bar.yaml"] {
            assert_eq!(hint(&folder.join(none)), "", "{none}");
        }
        let error = format!("{:#}", read_text("model", &folder.join("models/soft_bar.yml")).unwrap_err());
        assert!(error.starts_with("model ") && error.contains("No such file") && error.contains(&right), "{error}");
        assert_eq!(read_text("model", &folder.join("models/soft_bar.yaml")).unwrap(), "text");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
