//! Error of a command that Ctrl-C ended.

use catenary_bag::BagError;
use std::fmt::Display;
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

    /// Work that goes on later: `done` so far, such as `3 of 5 episodes`, and the file that keeps it. `option` is what the same command needs to go
    /// on; it may be empty.
    pub fn kept(done: impl Display, file: impl Display, option: &str) -> Self {
        let with = if option.is_empty() { String::new() } else { format!(" with {option}") };
        Self(format!(" after {done}; kept: {file}; to go on: the same command{with}"))
    }

    /// Work of which nothing is kept.
    pub fn lost(done: impl Display) -> Self {
        Self(format!(" after {done}; kept: nothing; to begin again: the same command"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interruption_says_what_is_kept_and_how_to_go_on() {
        let words = Interrupted::kept("3 of 9 steps", "p.state", "--resume").to_string();
        assert_eq!(words, "interrupted after 3 of 9 steps; kept: p.state; to go on: the same command with --resume");
        assert!(Interrupted::kept("1 run", "runs", "").to_string().ends_with("to go on: the same command"));
        let words = Interrupted::lost("2 of 9 steps").to_string();
        assert_eq!(words, "interrupted after 2 of 9 steps; kept: nothing; to begin again: the same command");
    }
}
