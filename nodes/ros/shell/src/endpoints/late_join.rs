//! History of a transient-local subscription: delivers only the last messages of each publisher. Pure; the caller passes the
//! time.

use crate::time::point::Time;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Silence after which a publisher has sent its whole history. Chosen: a history arrives without gaps.
const SILENCE: Duration = Duration::from_millis(100);

/// Maximum delay of the history, also for a publisher that is never silent.
const PATIENCE: Duration = Duration::from_secs(1);

/// Identifier of a publisher.
pub(crate) type Publisher = [u8; 16];

struct Past<T> {
    messages: VecDeque<T>,
    first: Time,
    last: Time,
}

impl<T> Past<T> {
    fn due(&self) -> Time {
        (self.last + SILENCE).min(self.first + PATIENCE)
    }
}

/// Buffer of messages that were sent before the subscription. It holds them back until the newest ones are known.
///
/// RustDDS trims the history of a writer only every 6 s, and not at all without a reader. A late subscriber would otherwise
/// receive minutes of old states.
pub(crate) struct LateJoin<T> {
    since: Time,
    depth: usize,
    past: BTreeMap<Publisher, Past<T>>,
}

impl<T> LateJoin<T> {
    /// Creates the buffer of a subscription that began at `since` (wall time) and requested `depth` messages.
    pub(crate) fn new(since: Time, depth: u16) -> Self {
        Self { since, depth: usize::from(depth.max(1)), past: BTreeMap::new() }
    }

    /// Takes a message that was sent at `sent` and arrived at `now`. Calls `deliver` with every message that is due.
    pub(crate) fn message(
        &mut self,
        message: T,
        publisher: Publisher,
        sent: Option<Time>,
        now: Time,
        mut deliver: impl FnMut(T),
    ) {
        // A message without a source timestamp counts as live.
        if sent.is_none_or(|sent| sent >= self.since) {
            // A live message ends the history of its publisher, and must come after it.
            let past = self.past.remove(&publisher).map(|past| past.messages);
            past.into_iter().flatten().for_each(&mut deliver);
            deliver(message);
            return;
        }
        let past =
            self.past.entry(publisher).or_insert_with(|| Past { messages: VecDeque::new(), first: now, last: now });
        if past.messages.len() == self.depth {
            past.messages.pop_front();
        }
        past.messages.push_back(message);
        past.last = now;
    }

    /// Returns the time at which the next history is due.
    pub(crate) fn due(&self) -> Option<Time> {
        self.past.values().map(Past::due).min()
    }

    /// Calls `deliver` with every message that is due at `now`.
    pub(crate) fn deliver_due(&mut self, now: Time, mut deliver: impl FnMut(T)) {
        let due: Vec<_> = self.past.iter().filter(|(_, past)| past.due() <= now).map(|(id, _)| *id).collect();
        for publisher in due {
            let past = self.past.remove(&publisher).map(|past| past.messages);
            past.into_iter().flatten().for_each(&mut deliver);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Publisher = [1; 16];
    const B: Publisher = [2; 16];

    fn at(millis: i64) -> Time {
        Time::from_nanos(millis * 1_000_000)
    }

    struct Bench {
        late: LateJoin<u32>,
        got: Vec<u32>,
    }

    impl Bench {
        fn new(depth: u16) -> Self {
            Self { late: LateJoin::new(at(10_000), depth), got: Vec::new() }
        }

        fn message(&mut self, message: u32, publisher: Publisher, sent: i64, now: i64) {
            let got = &mut self.got;
            self.late.message(message, publisher, Some(at(sent)), at(now), |message| got.push(message));
        }

        fn wait(&mut self, now: i64) {
            let got = &mut self.got;
            self.late.deliver_due(at(now), |message| got.push(message));
        }
    }

    #[test]
    fn only_the_last_messages_of_a_history_are_delivered_after_a_silence() {
        let mut bench = Bench::new(2);
        for index in 0..50 {
            bench.message(index, A, i64::from(index), 10_010 + i64::from(index));
        }
        bench.message(90, B, 7, 10_010);
        bench.wait(10_100);
        assert_eq!(bench.got, [] as [u32; 0]);
        bench.wait(10_110);
        assert_eq!((bench.got.as_slice(), bench.late.due()), ([90].as_slice(), Some(at(10_159))));
        bench.wait(10_159);
        assert_eq!((bench.got.as_slice(), bench.late.due()), ([90, 48, 49].as_slice(), None));
    }

    #[test]
    fn a_live_message_comes_at_once_after_the_history_of_its_publisher() {
        let mut bench = Bench::new(1);
        bench.message(1, A, 10, 10_010);
        bench.message(2, A, 20, 10_011);
        bench.message(9, B, 20, 10_011);
        bench.message(3, A, 10_012, 10_012);
        assert_eq!(bench.got, [2, 3]);
    }

    #[test]
    fn a_publisher_whose_clock_is_behind_is_heard_once_a_second() {
        let mut bench = Bench::new(1);
        for index in 0..=60 {
            let now = 10_000 + i64::from(index) * 20;
            bench.wait(now);
            bench.message(index, A, now - 60_000, now);
        }
        assert_eq!(bench.got, [49]);
    }
}
