//! Errors of episodes and their tracks.

use crate::grip::GripError;
use thiserror::Error;

/// Reason for which there is no episode, or no track in an episode.
#[derive(Debug, Error, PartialEq)]
pub enum EpisodeError {
    /// No episode that has both a start and an end.
    #[error(
        "{cause}no complete episode: found {found}; needed are /episode/event, /dlo/keypoints and /panda/current_pose, and /policy/observation and /policy/action where a policy drives"
    )]
    NoEpisode {
        /// Defect of the records, with a trailing separator; empty if records are merely absent.
        cause: String,
        /// Summary of the records that exist.
        found: String,
    },
    /// All complete episodes ended with a fault, and no number was given.
    #[error("{0}: give the number of an episode to use it anyway")]
    Fault(String),
    /// Stream of the episode whose values are physically impossible.
    #[error("episode {episode}: {reason}")]
    Impossible {
        /// Number of the episode.
        episode: u32,
        /// Topic, field, value and expectation.
        reason: String,
    },
    /// Complete episodes exist, but none has the requested number.
    #[error("episode {number}: expected one of the complete episodes {complete:?}")]
    NoSuchEpisode {
        /// Requested number.
        number: u32,
        /// Numbers of the complete episodes.
        complete: Vec<u32>,
    },
    /// Records that the model's `drive` requires are missing from the episode.
    #[error("episode {episode}: {cause}needs {needed}, found {found}")]
    Missing {
        /// Number of the episode.
        episode: u32,
        /// Known defects of the recording, with a trailing separator; empty if there are none.
        cause: String,
        /// Records that the track needs.
        needed: String,
        /// Summary of the records that exist.
        found: String,
    },
    /// Measured poses from which no grip path can be built.
    #[error(transparent)]
    Grip(#[from] GripError),
}
