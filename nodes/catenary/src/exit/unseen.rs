//! Images in which the object of a command was not seen.

use super::misfit::Misfit;
use thiserror::Error;

/// Error of a command that has looked and has seen no object, or something that is hardly one. The program's exit code is then
/// [`Unseen::EXIT_CODE`].
#[derive(Debug, Error)]
#[error("{0}")]
pub struct Unseen(
    /// Reason in a few words.
    pub String,
);

impl Unseen {
    /// Exit code of a result that was printed and does not fit the data.
    pub const EXIT_CODE: u8 = Misfit::EXIT_CODE;
}
