//! A goal as its handler sees it, and the way from the handler back to the server.

use super::goals::Id;
use crate::interface::Act;
use crate::peers::Requester;
use crate::shutdown::{Shutdown, Wake};
use rustdds::mio1::Waker;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::Duration;

/// How many goals may run at the same time; further ones are rejected, and the reason is logged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Concurrency {
    /// One.
    One,
    /// This many.
    Many(usize),
}

/// What becomes of a new goal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Decision {
    /// It runs.
    Accept,
    /// It does not; the reason is logged, for the protocol has no place for it.
    Reject(String),
}

/// How a goal ended, with its result.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome<R> {
    /// It reached what it was for.
    Succeeded(R),
    /// It ended early because a client cancelled it.
    Canceled(R),
    /// It was given up.
    Aborted(R),
}

/// A goal that runs, as its handler sees it.
pub struct GoalHandle<A: Act> {
    pub(super) goal: Arc<A::Goal>,
    pub(super) id: Id,
    pub(super) requester: Requester,
    pub(super) cancelled: Shutdown,
    pub(super) mailbox: Mailbox<A>,
}

impl<A: Act> GoalHandle<A> {
    /// What was asked for.
    #[must_use]
    pub fn goal(&self) -> &A::Goal {
        &self.goal
    }

    /// Who asked for it.
    #[must_use]
    pub fn requester(&self) -> &Requester {
        &self.requester
    }

    /// Tells the clients how far it is.
    pub fn feedback(&self, feedback: A::Feedback) {
        self.mailbox.send(Mail::Feedback(self.id, feedback));
    }

    /// Whether a client cancelled the goal or the node shuts down: the handler must end soon.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.is_triggered()
    }

    /// Waits for cancellation or for `timeout`; returns whether it is cancelled.
    #[must_use]
    pub fn wait_cancelled(&self, timeout: Duration) -> bool {
        self.cancelled.wait_timeout(timeout)
    }
}

/// What a handler has to say to its server.
pub(super) enum Mail<A: Act> {
    Feedback(Id, A::Feedback),
    Done(Id, Outcome<A::Result>),
}

/// Where handlers leave it.
pub(super) struct Mailbox<A: Act> {
    pub(super) sender: Sender<Mail<A>>,
    pub(super) bell: Arc<Bell>,
}

impl<A: Act> Clone for Mailbox<A> {
    fn clone(&self) -> Self {
        Self { sender: self.sender.clone(), bell: Arc::clone(&self.bell) }
    }
}

impl<A: Act> Mailbox<A> {
    pub(super) fn send(&self, mail: Mail<A>) {
        // A server that has ended needs no mail.
        if self.sender.send(mail).is_ok() {
            self.bell.wake();
        }
    }
}

/// Wakes the server's thread.
pub(super) struct Bell(pub(super) Waker);

impl Wake for Bell {
    fn wake(&self) {
        if let Err(error) = self.0.wake() {
            tracing::error!("action server: cannot be woken: {error}");
        }
    }
}
