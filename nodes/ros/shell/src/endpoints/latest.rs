//! Newest message of a topic, and queue of its messages.

use super::subscription::{Received, Subscription};
use crate::dds::interface::Msg;
use crate::time::point::Time;
use crate::time::shutdown::Signal;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Newest message of a topic. Clones share it. The subscription ends with the last clone.
#[derive(Clone)]
pub struct Latest<M: Msg> {
    slot: Arc<Signal<Option<Received<M>>>>,
    subscription: Arc<Subscription>,
}

impl<M: Msg> Latest<M> {
    pub(super) fn new(slot: Arc<Signal<Option<Received<M>>>>, subscription: Subscription) -> Self {
        Self { slot, subscription: Arc::new(subscription) }
    }

    /// Returns the newest message; `None` before the first.
    #[must_use]
    pub fn get(&self) -> Option<Received<M>> {
        self.slot.lock().clone()
    }

    /// Returns the newest message if it is not older than `age` at `now`.
    #[must_use]
    pub fn fresh(&self, now: Time, age: Duration) -> Option<Received<M>> {
        self.get().filter(|received| now.saturating_since(received.received) <= age)
    }

    /// Waits for a message with a count above `seen` (0: any), and returns the newest one. Returns `None` on timeout, in wall time,
    /// or shutdown.
    #[must_use]
    pub fn wait_newer(&self, seen: u64, timeout: Duration) -> Option<Received<M>> {
        let deadline = Instant::now() + timeout;
        let mut guard = self.slot.lock();
        loop {
            if let Some(received) = guard.as_ref().filter(|received| received.count > seen) {
                return Some(received.clone());
            }
            // Checked after the messages: one that came before the end is still delivered.
            if self.subscription.is_over() || Instant::now() >= deadline {
                return None;
            }
            guard = self.slot.wait_until(guard, Some(deadline));
        }
    }

    /// Returns the absolute name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.subscription.topic()
    }
}

/// Messages of a queue.
pub(super) struct Backlog<M> {
    pub(super) messages: VecDeque<Received<M>>,
    pub(super) dropped: u64,
}

impl<M> Backlog<M> {
    /// Adds a message. A full queue drops its oldest message, and returns true.
    pub(super) fn push(&mut self, message: Received<M>, capacity: usize) -> bool {
        let is_full = self.messages.len() == capacity;
        if is_full {
            self.messages.pop_front();
            self.dropped += 1;
        }
        self.messages.push_back(message);
        is_full
    }
}

/// Queue of the messages of a topic, up to a capacity. Clones share it.
#[derive(Clone)]
pub struct Queue<M: Msg> {
    backlog: Arc<Signal<Backlog<M>>>,
    subscription: Arc<Subscription>,
}

impl<M: Msg> Queue<M> {
    pub(super) fn new(backlog: Arc<Signal<Backlog<M>>>, subscription: Subscription) -> Self {
        Self { backlog, subscription: Arc::new(subscription) }
    }

    /// Takes the oldest message, without waiting.
    #[must_use]
    pub fn try_next(&self) -> Option<Received<M>> {
        self.backlog.lock().messages.pop_front()
    }

    /// Waits for the oldest message and takes it. Returns `None` on timeout, in wall time, or shutdown.
    #[must_use]
    pub fn next(&self, timeout: Duration) -> Option<Received<M>> {
        let deadline = Instant::now() + timeout;
        let mut guard = self.backlog.lock();
        loop {
            if let Some(received) = guard.messages.pop_front() {
                return Some(received);
            }
            if self.subscription.is_over() || Instant::now() >= deadline {
                return None;
            }
            guard = self.backlog.wait_until(guard, Some(deadline));
        }
    }

    /// Returns the number of messages lost because the queue was full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.backlog.lock().dropped
    }

    /// Returns the absolute name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.subscription.topic()
    }
}
