//! Error of a command that Ctrl-C ended.

use catenary_bag::BagError;
use thiserror::Error;

/// End of a command by Ctrl-C. The program's exit code is then [`Interrupted::EXIT_CODE`].
#[derive(Debug, Error)]
#[error("interrupted{0}")]
pub struct Interrupted(
    /// Progress so far, with a leading separator; may be empty.
    pub String,
);

impl Interrupted {
    /// Exit code of a program that SIGINT ended, as shells define it: 128 + 2.
    pub const EXIT_CODE: u8 = 130;

    /// True if Ctrl-C caused an error, of this crate or of the reader of bags.
    pub fn is(error: &anyhow::Error) -> bool {
        error.is::<Self>() || matches!(error.downcast_ref(), Some(BagError::Interrupted { .. }))
    }
}
