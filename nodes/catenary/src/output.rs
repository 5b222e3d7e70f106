//! Results go to stdout, as text or as JSON, and to files that are tried before the work begins; everything else goes to
//! stderr.

use crate::cli::Output;
use anyhow::{Context, Result};
use serde::Serialize;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;

/// Prints a result: as one JSON document with `--json`, else as `text` words it.
pub fn result<T: Serialize>(output: &Output, value: &T, text: impl FnOnce(&T) -> String) -> Result<()> {
    let words = if output.json { serde_json::to_string_pretty(value)? } else { text(value) };
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{words}") {
        // The reader of a pipe went away: nobody is left to tell.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        other => Ok(other?),
    }
}

/// A line for the user, apart from the result.
pub fn tell(line: &str) {
    let _closed = writeln!(std::io::stderr(), "{line}");
}

/// Makes the folder of a file that is to be written in the end, and fails now where it could not be written then. What lies
/// there stays as it is.
pub fn prepare(file: &Path) -> Result<()> {
    if let Some(folder) = file.parent().filter(|f| !f.as_os_str().is_empty()) {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let is_new = !file.exists();
    let opened = OpenOptions::new().create(true).append(true).open(file);
    opened.with_context(|| format!("{}: it cannot be written", file.display()))?;
    if is_new {
        fs::remove_file(file).with_context(|| file.display().to_string())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_written_is_refused_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("not/yet/there.json");
        prepare(&file).unwrap();
        assert!(file.parent().unwrap().is_dir() && !file.exists(), "the folder is made, the file is left to the work");
        fs::write(&file, "old").unwrap();
        prepare(&file).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "old");
        let below = prepare(&file.join("x")).unwrap_err();
        assert!(format!("{below:#}").contains("there.json"), "{below:#}");
        let taken = prepare(file.parent().unwrap()).unwrap_err();
        assert!(format!("{taken:#}").contains("yet: it cannot be written"), "{taken:#}");
    }
}
