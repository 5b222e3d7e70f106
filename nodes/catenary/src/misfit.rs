//! Results that fit nothing of the recording: they are written, and do not look like a success.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// A result was written and fits nothing of the recording; the program's exit code is then [`Misfit::EXIT_CODE`].
#[derive(Debug, Error)]
#[error("the result, written to {}, does not fit the recording", folder.display())]
pub struct Misfit {
    /// Where the result lies.
    folder: PathBuf,
}

impl Misfit {
    /// That of a program whose work was done and came to nothing, apart from failures (1) and wrong command lines (2).
    pub const EXIT_CODE: u8 = 3;

    /// Fails where there is a reason.
    ///
    /// # Errors
    /// The misfit.
    pub fn check(reason: Option<&String>, folder: &Path) -> anyhow::Result<()> {
        match reason {
            None => Ok(()),
            Some(_) => Err(Self { folder: folder.to_owned() }.into()),
        }
    }

    /// The first line of what is printed of a result.
    pub fn headline(reason: &str) -> String {
        format!("DOES NOT FIT the recording: {reason}")
    }
}
