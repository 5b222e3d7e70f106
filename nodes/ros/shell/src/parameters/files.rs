//! Files that the user names: reading them, writing results, and suggestions for a path that does not exist.

use anyhow::{Context, Result, anyhow};
use catenary_core::spelling::nearest;
use std::fs::{File, OpenOptions};
use std::hash::{BuildHasher, RandomState};
use std::io::{Error, Read, Write};
use std::path::{Component, Path, PathBuf};

/// Maximum number of names in a folder that are compared with a misspelt one.
const MOST_NAMES: usize = 10_000;
/// Size limit of a file that is read whole, bytes: ten times the largest one that catenary writes, and little of a machine's memory.
const MOST_BYTES: u64 = 256 << 20;

/// Reads the text of the file at `path`. `what` names its role, for example `model`.
///
/// # Errors
/// Message of the form `WHAT PATH: REASON`, with the nearest existing path. A file of more than 256 MiB.
pub fn read_text(what: &str, path: &Path) -> Result<String> {
    let bytes = read_bytes(what, path)?;
    String::from_utf8(bytes).with_context(|| format!("{}: expected text in UTF-8", named(what, path)))
}

/// Reads the bytes of the file at `path`.
///
/// # Errors
/// As [`read_text`].
pub fn read_bytes(what: &str, path: &Path) -> Result<Vec<u8>> {
    read_at_most(what, path, MOST_BYTES)
}

/// Reads the bytes of the file at `path`, whose kind has at most `most` bytes. No more than that is read, so that a file that never ends, as
/// `/dev/zero`, fills no memory.
///
/// # Errors
/// As [`read_text`], with this limit.
pub fn read_at_most(what: &str, path: &Path, most: u64) -> Result<Vec<u8>> {
    let read = || {
        let mut bytes = Vec::new();
        File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let bytes = read().map_err(|error| explained(path, error)).with_context(|| named(what, path))?;
    anyhow::ensure!(bytes.len() as u64 <= most, "{}: expected at most {}", named(what, path), size(most));
    Ok(bytes)
}

/// Size in the largest unit that divides it.
fn size(bytes: u64) -> String {
    match bytes {
        b if b.is_multiple_of(1 << 20) => format!("{} MiB", b >> 20),
        b if b.is_multiple_of(1 << 10) => format!("{} KiB", b >> 10),
        b => format!("{b} bytes"),
    }
}

/// Writes the file at `path` whole or not at all: a write that fails, as on a full disk, leaves an existing file as it
/// was and nothing beside it. A process that is killed leaves the file as it was, and perhaps a draft `.catenary-NUMBER.draft` beside it.
///
/// # Errors
/// Message of the form `PATH: REASON`, whose source is the [`std::io::Error`].
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    replace(path, bytes.as_ref()).with_context(|| path.display().to_string())
}

/// Writes as [`write()`], for errors of other types.
///
/// # Errors
/// Error of the operating system.
pub fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    // The file behind a link is replaced, and the link stays.
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let old = std::fs::metadata(&target).ok();
    // A terminal, a pipe or /dev/null has no contents to keep, and must stay what it is.
    if old.as_ref().is_some_and(|old| !old.is_file()) {
        return OpenOptions::new().write(true).open(&target)?.write_all(bytes);
    }
    let draft = draft_beside(&target);
    let written = write_draft(&draft, bytes, old.as_ref()).and_then(|()| std::fs::rename(&draft, &target));
    if written.is_err() {
        // The first error is the one that counts.
        let _ = std::fs::remove_file(&draft);
        return written;
    }
    // The name survives a loss of power, too. A file system without this is no reason to fail.
    let _ = File::open(folder_of(&target)).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Checks that [`write()`] could write the file at `path`, whose folder exists. Leaves everything as it was.
///
/// # Errors
/// Error of the operating system.
pub fn check_writable(path: &Path) -> std::io::Result<()> {
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let is_there = std::fs::metadata(&target).is_ok();
    if is_there {
        OpenOptions::new().append(true).open(&target)?;
    }
    if is_there && !target.is_file() {
        return Ok(());
    }
    let draft = draft_beside(&target);
    File::create_new(&draft)?;
    std::fs::remove_file(&draft)
}

fn write_draft(draft: &Path, bytes: &[u8], old: Option<&std::fs::Metadata>) -> std::io::Result<()> {
    let mut file = File::create_new(draft)?;
    if let Some(old) = old {
        file.set_permissions(old.permissions())?;
    }
    file.write_all(bytes)?;
    // Some file systems notice a full disk only here. Without it, a loss of power after the rename could leave an empty file.
    file.sync_all()
}

/// Path of a draft in the folder of `target`: a rename between folders may not be atomic. The number is random, because processes of several
/// machines may share the folder.
fn draft_beside(target: &Path) -> PathBuf {
    folder_of(target).join(format!(".catenary-{:016x}.draft", RandomState::new().hash_one(target)))
}

fn folder_of(target: &Path) -> &Path {
    match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
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

    /// Folder of a test, which is removed at its end.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let folder = std::env::temp_dir().join(format!("catenary_{name}_{}", std::process::id()));
            std::fs::create_dir_all(&folder).unwrap();
            Self(folder)
        }

        fn names(&self) -> Vec<String> {
            let entries = std::fs::read_dir(&self.0).unwrap();
            let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            std::fs::remove_dir_all(&self.0).unwrap();
        }
    }

    #[test]
    fn a_file_is_replaced_whole_and_keeps_its_permissions_and_links_to_it() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = Folder::new("replace");
        let (file, link) = (folder.0.join("policy"), folder.0.join("newest"));
        write(&file, "old").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o640)).unwrap();
        symlink("policy", &link).unwrap();
        check_writable(&link).unwrap();
        write(&link, "new").unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "new");
        assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o640);
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!(folder.names(), ["newest", "policy"]);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = Folder::new("failed_write");
        let file = folder.0.join("policy");
        write(&file, "old").unwrap();
        // A folder in the place of the file: the rename fails after the draft was written.
        let taken = folder.0.join("taken");
        std::fs::create_dir(&taken).unwrap();
        let error = write(&taken, "new").unwrap_err();
        assert!(format!("{error:#}").starts_with(&taken.display().to_string()), "{error:#}");
        assert!(write(&folder.0.join("nowhere/policy"), "new").is_err() && check_writable(&taken).is_err());
        assert_eq!(
            (std::fs::read_to_string(&file).unwrap().as_str(), folder.names()),
            ("old", vec!["policy".into(), "taken".into()])
        );
    }

    #[test]
    fn a_device_is_written_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let null = Path::new("/dev/null");
        check_writable(null).unwrap();
        write(null, "gone").unwrap();
        assert!(null.metadata().unwrap().file_type().is_char_device());
        let full = write(Path::new("/dev/full"), "x").unwrap_err();
        assert_eq!(full.downcast_ref::<Error>().unwrap().kind(), std::io::ErrorKind::StorageFull);
    }

    #[test]
    fn a_file_beyond_its_limit_is_refused_and_an_endless_one_fills_no_memory() {
        let folder = Folder::new("limit");
        let file = folder.0.join("policy");
        write(&file, [0; 2048]).unwrap();
        assert_eq!(read_at_most("policy", &file, 2048).unwrap().len(), 2048);
        let words = read_at_most("policy", &file, 1024).unwrap_err().to_string();
        assert_eq!(words, format!("policy {}: expected at most 1 KiB", file.display()));
        let endless = read_at_most("policy", Path::new("/dev/zero"), 1 << 20).unwrap_err().to_string();
        assert_eq!(endless, "policy /dev/zero: expected at most 1 MiB");
        write(&file, [0xff, 0xfe]).unwrap();
        assert!(read_text("model", &file).unwrap_err().to_string().ends_with("expected text in UTF-8"));
    }

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
