//! Backlog: messages that wait to be written.

use crate::node::kinds::Arrival;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

#[derive(Default)]
struct State {
    waiting: VecDeque<(usize, Arrival)>,
    bytes: usize,
    lost: u64,
    taken: u64,
}

/// Queue between the threads of the subscriptions and the writing thread, bounded in bytes. If the disk is slower than
/// the topics, the newest messages are lost and counted.
pub(crate) struct Backlog {
    state: Mutex<State>,
    filled: Condvar,
    capacity_bytes: usize,
}

impl Backlog {
    pub(crate) fn new(capacity_bytes: usize) -> Self {
        Self { state: Mutex::new(State::default()), filled: Condvar::new(), capacity_bytes }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends a message of the topic with this number. Returns false if there is no room; the message is then lost.
    pub(crate) fn push(&self, topic: usize, arrival: Arrival) -> bool {
        let mut state = self.lock();
        // The newest is dropped: the messages before it form a bag without gaps.
        if state.bytes + arrival.cdr.len() > self.capacity_bytes {
            state.lost += 1;
            return false;
        }
        state.bytes += arrival.cdr.len();
        state.waiting.push_back((topic, arrival));
        drop(state);
        self.filled.notify_one();
        true
    }

    /// Removes the oldest message and returns it with the number of its topic; none if none arrives before the timeout.
    pub(crate) fn next(&self, timeout: Duration) -> Option<(usize, Arrival)> {
        let state = self.lock();
        let waited = self.filled.wait_timeout_while(state, timeout, |s| s.waiting.is_empty());
        let mut state = waited.unwrap_or_else(PoisonError::into_inner).0;
        let next = state.waiting.pop_front()?;
        state.bytes -= next.1.cdr.len();
        state.taken += 1;
        Some(next)
    }

    /// Numbers of messages removed so far, and of messages lost.
    pub(crate) fn counts(&self) -> (u64, u64) {
        let state = self.lock();
        (state.taken, state.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_shell::Time;

    #[test]
    fn messages_beyond_the_capacity_are_lost_and_counted() {
        let arrival = |bytes| Arrival { cdr: vec![0; bytes], received: Time::ZERO, sent: None };
        let backlog = Backlog::new(100);
        assert!(backlog.push(0, arrival(60)));
        assert!(!backlog.push(0, arrival(50)));
        assert!(backlog.push(0, arrival(40)));
        let taken = |b: &Backlog| b.next(Duration::ZERO).map(|(_, a)| a.cdr.len());
        assert_eq!((taken(&backlog), taken(&backlog), taken(&backlog)), (Some(60), Some(40), None));
        assert!(backlog.push(0, arrival(100)));
        assert_eq!(backlog.counts(), (2, 1));
    }
}
