//! Results that do not fit the recording. They are written, but do not count as a success.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// Error for a written result that does not fit the recording. The program's exit code is then [`Misfit::EXIT_CODE`].
#[derive(Debug, Error)]
#[error("the result, written to {}, does not fit the recording", folder.display())]
pub struct Misfit {
    /// Folder of the result.
    folder: PathBuf,
}

impl Misfit {
    /// Exit code, distinct from failures (1) and wrong input (2).
    pub const EXIT_CODE: u8 = 3;

    /// Returns the misfit as an error if there is a reason for one.
    pub fn check(reason: Option<&String>, folder: &Path) -> anyhow::Result<()> {
        match reason {
            None => Ok(()),
            // The reason itself was printed with the result.
            Some(_) => Err(Self { folder: folder.to_owned() }.into()),
        }
    }

    /// First line of the printed result.
    pub fn headline(reason: &str) -> String {
        format!("DOES NOT FIT the recording: {reason}")
    }
}
