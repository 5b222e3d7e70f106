//! Handle of a goal for its handler, and the updates from the handler to the server's thread.

use super::goals::Id;
use crate::dds::interface::Act;
use crate::dds::peers::Requester;
use crate::time::shutdown::{Shutdown, Wake};
use rustdds::mio1::Waker;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::Duration;

/// Maximum number of goals that run at the same time. Further goals are rejected, and the reason is logged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Concurrency {
    /// One goal.
    One,
    /// Several goals.
    Many(usize),
}

/// Decision about a new goal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Run the goal.
    Accept,
    /// Reject the goal. The reason is logged: the protocol cannot carry it.
    Reject(String),
}

/// End of a goal, with its result.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome<R> {
    /// The goal was reached.
    Succeeded(R),
    /// A client cancelled the goal.
    Canceled(R),
    /// The goal was aborted.
    Aborted(R),
}

/// Running goal, for its handler.
pub struct GoalHandle<A: Act> {
    pub(super) goal: Arc<A::Goal>,
    pub(super) id: Id,
    pub(super) requester: Requester,
    pub(super) cancelled: Shutdown,
    pub(super) updates: Updates<A>,
}

impl<A: Act> GoalHandle<A> {
    /// Returns the goal.
    #[must_use]
    pub fn goal(&self) -> &A::Goal {
        &self.goal
    }

    /// Returns the node that sent the goal.
    #[must_use]
    pub fn requester(&self) -> &Requester {
        &self.requester
    }

    /// Sends feedback to the clients.
    pub fn feedback(&self, feedback: A::Feedback) {
        self.updates.send(Update::Feedback(self.id, feedback));
    }

    /// Returns true once a client cancelled the goal or the node shuts down: the handler must end soon.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.is_triggered()
    }

    /// Waits for cancellation, at most `timeout`. Returns true if the goal is cancelled.
    #[must_use]
    pub fn wait_cancelled(&self, timeout: Duration) -> bool {
        self.cancelled.wait_timeout(timeout)
    }
}

/// Message of a handler to its server.
pub(super) enum Update<A: Act> {
    Feedback(Id, A::Feedback),
    Done(Id, Outcome<A::Result>),
}

/// Sender of messages to the server's thread.
pub(super) struct Updates<A: Act> {
    pub(super) sender: Sender<Update<A>>,
    pub(super) waker: Arc<ServerWaker>,
}

impl<A: Act> Clone for Updates<A> {
    fn clone(&self) -> Self {
        Self { sender: self.sender.clone(), waker: Arc::clone(&self.waker) }
    }
}

impl<A: Act> Updates<A> {
    pub(super) fn send(&self, update: Update<A>) {
        // A failure means that the server has ended.
        if self.sender.send(update).is_ok() {
            self.waker.wake();
        }
    }
}

/// Waker of the server's thread.
pub(super) struct ServerWaker(pub(super) Waker);

impl Wake for ServerWaker {
    fn wake(&self) {
        if let Err(error) = self.0.wake() {
            tracing::error!("action server: cannot be woken: {error}");
        }
    }
}
