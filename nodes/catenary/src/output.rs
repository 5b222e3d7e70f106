//! Results go to stdout, as text or as JSON; everything else goes to stderr.

use crate::cli::Output;
use anyhow::Result;
use serde::Serialize;
use std::io::Write;

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
