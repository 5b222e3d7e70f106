//! Binding to one writer: an arm that follows the messages of one writer takes none of another.
//!
//! DDS puts the identifier of its writer beside every message. Names belong to nodes, and are looked up elsewhere: a motion ends at once,
//! and its fault gets the names a moment later.

use std::fmt;

/// Identifier of a writer of a topic (DDS GUID). A publisher that is started again has another one.
pub type Writer = [u8; 16];

/// Topic of a message that came from another writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heard {
    /// Target pose.
    Target,
    /// Start or end of an episode.
    EpisodeEvent,
    /// Pose of the controller behind the relay.
    ControllerPose,
}

/// Message of another writer than the one that the arm is bound to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stranger {
    /// Kind of the message.
    pub heard: Heard,
    /// Writer of the message.
    pub writer: Writer,
    /// Writer that the arm is bound to.
    pub bound: Writer,
}

impl Stranger {
    /// Describes the message with the names of both nodes.
    #[must_use]
    pub fn text(&self, stranger: &str, bound: &str) -> String {
        let (what, whose) = match self.heard {
            Heard::Target => ("a target", "the arm follows the targets of"),
            Heard::EpisodeEvent => ("an episode event", "the episode is that of"),
            Heard::ControllerPose => ("a pose of the controller", "the controller is"),
        };
        format!(
            "{what} came from {stranger} while {whose} {bound}: the motion ended; end one of the two, then enable the arm again"
        )
    }
}

impl fmt::Display for Stranger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(&hex(&self.writer), &hex(&self.bound)))
    }
}

impl std::error::Error for Stranger {}

fn hex(writer: &Writer) -> String {
    let digits: String = writer.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("writer {digits}")
}
