//! What a command says that Ctrl-C ended before its time.

use thiserror::Error;

/// A command was ended before its time; the program's exit code is then [`Interrupted::EXIT_CODE`].
#[derive(Debug, Error)]
#[error("interrupted{0}")]
pub struct Interrupted(
    /// What was done by then, behind a separator; empty where there is nothing to say.
    pub String,
);

impl Interrupted {
    /// As a shell has it for a program that SIGINT ended.
    pub const EXIT_CODE: u8 = 130;
}
