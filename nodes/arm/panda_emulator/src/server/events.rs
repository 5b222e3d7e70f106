//! Happenings that a server logs.

use crate::fci::{Errors, MoveStatus, RecoveryStatus, RobotMode, SetterStatus};
use crate::wire::WireError;
use std::collections::VecDeque;
use std::fmt;
use std::net::SocketAddr;

/// Events that a log keeps. Chosen: hours of motions, and less than a megabyte.
const CAPACITY: usize = 4096;

/// Happening in a session.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A client connected from this address.
    ClientConnected(SocketAddr),
    /// A client from this address was refused: another one has the session.
    ClientRefused(SocketAddr),
    /// A client of another version was refused.
    VersionRefused {
        /// Version of the client.
        client: u16,
        /// Version of the server.
        server: u16,
    },
    /// The client was dropped: these bytes of answers wait for it.
    ClientTooSlow {
        /// Answers that it has not read, bytes.
        bytes: usize,
    },
    /// The client left.
    ClientLeft,
    /// A motion began.
    MotionStarted,
    /// A motion ended, or was refused.
    MotionEnded(MoveStatus),
    /// A reflex stopped the arm.
    Reflex(Errors),
    /// The mode of the control box changed.
    Mode(RobotMode),
    /// The simulation of the arm diverged, and the arm was put at rest where it was before.
    Restored,
    /// A recovery was asked for, with this result.
    Recovery(RecoveryStatus),
    /// This setter was refused.
    SetterRefused(&'static str, SetterStatus),
    /// A socket for the client could not be opened.
    SocketFailed(String),
    /// Bytes of the client were no message.
    Malformed(WireError),
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ClientConnected(address) => write!(f, "client connected from {address}"),
            Self::ClientRefused(address) => write!(f, "client from {address} refused: another client is connected"),
            Self::VersionRefused { client, server } => {
                write!(f, "client of FCI {client} refused: this robot has FCI {server}")
            }
            Self::ClientTooSlow { bytes } => {
                write!(f, "client dropped: it reads its answers too slowly, {bytes} bytes wait")
            }
            Self::ClientLeft => write!(f, "client left"),
            Self::MotionStarted => write!(f, "motion started"),
            Self::MotionEnded(status) => write!(f, "motion ended: {status:?}"),
            Self::Reflex(errors) => write!(f, "reflex: {}", errors.names().collect::<Vec<_>>().join(", ")),
            Self::Mode(mode) => write!(f, "mode: {mode:?}"),
            Self::Restored => write!(f, "simulation of the arm diverged: the arm was put at rest where it was before"),
            Self::Recovery(status) => write!(f, "recovery: {status:?}"),
            Self::SetterRefused(setter, status) => write!(f, "{setter} refused: {status:?}"),
            Self::SocketFailed(error) => write!(f, "no socket for states: {error}"),
            Self::Malformed(error) => write!(f, "malformed message: {error}"),
        }
    }
}

/// Log of events with the clock of the control box, ms.
#[derive(Debug, Default)]
pub struct EventLog {
    events: VecDeque<(u64, Event)>,
}

impl EventLog {
    /// Adds an event. A full log loses its oldest.
    pub fn push(&mut self, message_id: u64, event: Event) {
        if self.events.len() == CAPACITY {
            self.events.pop_front();
        }
        self.events.push_back((message_id, event));
    }

    /// Takes all events, oldest first.
    pub fn take(&mut self) -> Vec<(u64, Event)> {
        self.events.drain(..).collect()
    }

    /// Returns true if the log is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.events.is_empty()
    }
}
