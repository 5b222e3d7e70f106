//! Clocks of a recording: comparison of the stamps of messages with their log times.
//!
//! Messages come in order of log time, and nothing is kept of most of them: memory does not grow with a recording.

mod offset;
mod steps;
mod times;

use offset::Offsets;
use std::collections::BTreeMap;
use steps::{Step, Steps};
use times::Times;

/// Least number of messages of a stream for a statement about its clock.
const FEW: usize = 2;

/// State of the clock of one topic.
#[derive(Debug, Default)]
struct Topic {
    count: usize,
    steps: Steps,
    offsets: Offsets,
}

/// Comparison of the clocks that stamp the topics of a bag. Messages must be added in order of log time. Latched topics
/// must not be added: a recorder that starts late logs their old messages at its own time.
#[derive(Debug, Default)]
pub(crate) struct Clocks {
    /// Name of the topic whose clock is the reference.
    reference: String,
    /// Newest message of the reference.
    known: Option<Times>,
    topics: BTreeMap<String, Topic>,
}

impl Clocks {
    /// Comparison with the clock of the topic `reference`.
    pub(crate) fn new(reference: &str) -> Self {
        Self { reference: reference.to_owned(), ..Self::default() }
    }

    /// Adds the times of a message. A stamp of 0 means no stamp and is skipped.
    pub(crate) fn push(&mut self, topic: &str, log_ns: i64, stamp_ns: i64) {
        if stamp_ns == 0 {
            return;
        }
        let times = Times { log_ns, stamp_ns };
        if topic == self.reference {
            let before = self.known.replace(times);
            self.topics.values_mut().for_each(|other| other.offsets.settle(before, Some(times)));
        }
        if !self.topics.contains_key(topic) {
            self.topics.insert(topic.to_owned(), Topic::default());
        }
        let Some(of_topic) = self.topics.get_mut(topic) else { return };
        of_topic.count += 1;
        of_topic.steps.push(times);
        if topic != self.reference {
            of_topic.offsets.push(times, self.known);
        }
    }

    /// Sentences about clocks that were set, or that differ from that of the reference.
    pub(crate) fn notes(mut self) -> Vec<String> {
        let known = self.known;
        self.topics.values_mut().for_each(|topic| topic.offsets.settle(known, None));
        let mut steps: Vec<(&str, Step)> = Vec::new();
        for (name, topic) in &mut self.topics {
            steps.extend(topic.steps.first().map(|step| (name.as_str(), step)));
        }
        // A clock that was set also differs from others afterwards: only the cause is named.
        if !steps.is_empty() {
            return steps::notes(&steps);
        }
        if self.topics.get(&self.reference).is_none_or(|known| known.count < FEW) {
            return Vec::new();
        }
        let others = self.topics.iter().filter(|(topic, of_topic)| **topic != self.reference && of_topic.count >= FEW);
        others.filter_map(|(topic, of_topic)| of_topic.offsets.note(topic, &self.reference)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Log times and stamps of a topic, in ms.
    struct Logged(&'static str, Vec<(i64, i64)>);

    /// Messages at 100 Hz for `seconds`. `at` maps a time to the log time and the stamp, all in ms.
    fn long(topic: &'static str, seconds: i64, at: impl Fn(i64) -> (i64, i64)) -> Logged {
        Logged(topic, (0..100 * seconds).map(|i| at(1_000_000 + 10 * i)).collect())
    }

    fn logged(topic: &'static str, at: impl Fn(i64) -> (i64, i64)) -> Logged {
        long(topic, 4, at)
    }

    /// Notes on these topics, whose messages are added in order of log time.
    fn notes(topics: &[Logged]) -> Vec<String> {
        let mut all: Vec<(i64, i64, &str)> = topics
            .iter()
            .flat_map(|Logged(topic, times)| times.iter().map(|(log, stamp)| (*log, *stamp, *topic)))
            .collect();
        all.sort_unstable();
        let mut clocks = Clocks::new("/pose");
        all.iter().for_each(|(log_ms, stamp_ms, topic)| clocks.push(topic, 1_000_000 * log_ms, 1_000_000 * stamp_ms));
        clocks.notes()
    }

    fn poses() -> Logged {
        logged("/pose", |t| (t + 2, t))
    }

    #[test]
    fn a_clock_that_was_set_is_named_with_all_topics_that_it_stamps() {
        for (step_ms, words) in [(-3_600_000, "back by 3600.0"), (-400, "back by 0.4"), (900, "ahead by 0.9")] {
            let set = |t: i64| (t + 2, if t >= 1_002_000 { t + step_ms } else { t });
            let notes = notes(&[logged("/b", set), logged("/pose", set)]);
            assert!(notes.len() == 1 && notes[0].starts_with("/b, /pose: header.stamp"), "{notes:?}");
            assert!(notes[0].contains(words) && notes[0].contains("log time 1002.002 s"), "{notes:?}");
        }
        assert_eq!(notes(&[poses()]), [] as [String; 0]);
    }

    #[test]
    fn a_recorder_that_stalls_or_loses_messages_sets_no_clock() {
        let late = |t: i64| if (1_001_000..1_003_000).contains(&t) { 1_003_000 + (t - 1_001_000) / 100 } else { t + 2 };
        assert_eq!(notes(&[logged("/pose", |t| (late(t), t))]), [] as [String; 0]);
        let lost = |t: i64| if t > 1_002_000 { t + 3000 } else { t };
        assert_eq!(notes(&[logged("/pose", |t| (lost(t) + 2, lost(t)))]), [] as [String; 0]);
        // A slow tracker, in a bag that was recorded from a replay at a quarter of the rate.
        let slow = [logged("/keypoints", |t| (4 * t + 150, t)), logged("/pose", |t| (4 * t, t))];
        assert_eq!(notes(&slow), [] as [String; 0]);
    }

    #[test]
    fn a_stall_with_losses_is_no_clock_that_was_set_whatever_follows_it() {
        // The messages of 0.3 s come 3 s late, those of the 2.7 s after them are lost.
        let stalled = |from: i64| {
            move |Logged(topic, times): Logged| {
                let lost = from + 300..from + 3000;
                let times = times.into_iter().filter(|(_, stamp)| !lost.contains(stamp));
                let late = |(log, stamp): (i64, i64)| match (from..from + 300).contains(&stamp) {
                    true => (from + 3000 + (stamp - from) / 100, stamp),
                    false => (log, stamp),
                };
                Logged(topic, times.map(late).collect())
            }
        };
        let poses = || long("/pose", 20, |t| (t + 2, t));
        for from in [1_000_000, 1_000_050, 1_005_000, 1_016_990] {
            assert_eq!(notes(&[stalled(from)(poses())]), [] as [String; 0], "{from}");
        }
        // A busy machine keeps the queue of a subscription full for 5 s: everything is 2 s late, and then the queue is lost.
        let busy = |t: i64| if (1_003_000..1_008_000).contains(&t) { (t + 2000, t) } else { (t + 2, t) };
        let Logged(topic, times) = long("/pose", 20, busy);
        let times = times.into_iter().filter(|(_, stamp)| !(1_008_000..1_010_000).contains(stamp)).collect();
        assert_eq!(notes(&[Logged(topic, times)]), [] as [String; 0]);
        // A clock that is set after a stall is still found.
        let Logged(topic, times) = stalled(1_005_000)(poses());
        let set = |(log, stamp)| (log, if stamp > 1_012_000 { stamp + 900 } else { stamp });
        let found = notes(&[Logged(topic, times.into_iter().map(set).collect())]);
        assert!(found.len() == 1 && found[0].contains("ahead by 0.9"), "{found:?}");
    }

    #[test]
    fn a_publisher_that_stalls_sets_no_clock() {
        // Its timer catches up: the missed stamps come at once, or not at all.
        for catches_up in [true, false] {
            let at = |t: i64| if (1_005_000..1_008_000).contains(&t) { (1_008_002, 1_008_000) } else { (t + 2, t) };
            let Logged(topic, mut times) = long("/pose", 20, at);
            if !catches_up {
                times.dedup();
            }
            assert_eq!(notes(&[Logged(topic, times)]), [] as [String; 0]);
        }
    }

    #[test]
    fn stamps_that_run_faster_than_the_log_step_only_where_their_pace_does() {
        // A policy that acts twice a second and rests for 20 s between two episodes, with a pose every half second.
        let slowly = |t: i64| 1_000_000 + 50 * (t - 1_000_000);
        let rests = |t: i64| slowly(t) + if t >= 1_002_000 { 20_000 } else { 0 };
        for pace in [2, 5, 20] {
            let poses = logged("/pose", |t| (slowly(t) / pace, slowly(t)));
            let both = [logged("/action", |t| (rests(t) / pace, rests(t) + 7)), poses];
            assert_eq!(notes(&both), [] as [String; 0], "{pace}");
            let set = |t: i64| (t / pace, if t >= 1_002_000 { t + 900 } else { t });
            let notes = notes(&[logged("/pose", set)]);
            assert!(notes.len() == 1 && notes[0].contains("steps ahead by 0."), "{notes:?}");
        }
        let two = Logged("/action", vec![(0, 1), (6000, 11_000)]);
        assert_eq!(notes(&[two]), [] as [String; 0]);
    }

    #[test]
    fn clocks_that_differ_are_named_with_their_difference() {
        for (offset_ms, words) in [(-700, "0.7"), (300, "0.3"), (86_400_000, "86400.0"), (-1_700_000_000, "1700000.0")]
        {
            let notes = notes(&[logged("/keypoints", |t| (t + 2, t + offset_ms)), poses()]);
            let way = if offset_ms < 0 { "s behind its" } else { "s ahead of its" };
            assert!(notes.len() == 1 && notes[0].starts_with("/keypoints: header.stamp"), "{notes:?}");
            assert!(notes[0].contains(way) && notes[0].contains(&format!("stamps {words}")), "{notes:?}");
        }
        assert_eq!(notes(&[logged("/keypoints", |t| (t + 120, t)), poses()]), [] as [String; 0]);
    }
}
