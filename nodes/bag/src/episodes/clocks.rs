//! Clocks of a recording: comparison of the stamps of messages with their log times.

use catenary_core::statistics::{QuantileMethod, median_high, quantile};
use std::collections::BTreeMap;

/// Backward step of the stamps in s above which a clock was set. Messages of one publisher overtake each other by less.
const BACK_S: f64 = 0.1;
/// Step of the stamps ahead of the log times in s above which a clock was set.
const AHEAD_S: f64 = 0.5;
/// Number of messages on either side of a step that distinguish it from a stall of the recorder.
const WINDOW: usize = 10;
/// Pace of the stamps below which they run with the log times: the jitter of a clock that is not simulated is smaller.
const PACE_NEAR_1: f64 = 1.05;
/// Share by which a faster pace may vary over a gap: the pace of a simulation depends on its load.
const PACE_VARIES: f64 = 0.1;
/// Greatest delay in s of a stream from stamp to log beyond that of the poses: exposure, transport and a slow tracker.
const LATE_S: f64 = 0.5;
/// Greatest time in s by which a stream's delay may be shorter than that of the poses: no message arrives before it was
/// measured.
const EARLY_S: f64 = 0.1;
/// Greatest time in s between the log times of two messages that are compared. Farther apart, a faster pace of the
/// stamps would count as a difference.
const TOGETHER_S: f64 = 0.1;
/// Share of the messages that may be closer than the difference of two clocks: a stall of the recorder delays some.
const OUTLIERS: f64 = 0.1;
/// Least number of messages of a stream for a statement about its clock.
const FEW: usize = 2;

/// Times of one message in ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Times {
    log_ns: i64,
    stamp_ns: i64,
}

impl Times {
    /// Time from stamp to log in s.
    fn delay_s(self) -> f64 {
        since_s(self.log_ns, self.stamp_ns)
    }
}

fn since_s(later_ns: i64, earlier_ns: i64) -> f64 {
    (i128::from(later_ns) - i128::from(earlier_ns)) as f64 * 1e-9
}

/// Step of a clock that was set while it stamped a topic.
struct Step {
    at_log_ns: i64,
    by_s: f64,
}

/// Times of the messages of a bag, by topic, in order of log time. Latched topics must not be added: a recorder that
/// starts late logs their old messages at its own time.
#[derive(Debug, Default)]
pub(crate) struct Clocks {
    topics: BTreeMap<String, Vec<Times>>,
}

impl Clocks {
    /// Adds the times of a message. A stamp of 0 means no stamp and is skipped.
    pub(crate) fn push(&mut self, topic: &str, log_ns: i64, stamp_ns: i64) {
        if stamp_ns != 0 {
            self.topics.entry(topic.to_owned()).or_default().push(Times { log_ns, stamp_ns });
        }
    }

    /// Sentences about clocks that were set, or that differ from the clock of the topic `reference`.
    pub(crate) fn notes(&self, reference: &str) -> Vec<String> {
        let steps: Vec<(&str, Step)> =
            self.topics.iter().filter_map(|(topic, times)| Some((topic.as_str(), step(times)?))).collect();
        // A clock that was set also differs from others afterwards: only the cause is named.
        if !steps.is_empty() {
            return step_notes(&steps);
        }
        let Some(known) = self.topics.get(reference) else { return Vec::new() };
        let others = self.topics.iter().filter(|(topic, _)| *topic != reference);
        others.filter_map(|(topic, times)| offset_note(topic, offset_s(times, known)?, reference)).collect()
    }
}

/// First step of a topic's clock, relative to its pace.
///
/// The pace is not 1 for a bag that was recorded from simulated time or from a faster replay. A recorder that stalls
/// logs messages late and recovers; a clock that was set stays so.
fn step(times: &[Times]) -> Option<Step> {
    (1..times.len()).find_map(|i| {
        let stamps_s = since_s(times[i].stamp_ns, times[i - 1].stamp_ns);
        let log_s = since_s(times[i].log_ns, times[i - 1].log_ns);
        let (before, after) = (&times[i.saturating_sub(WINDOW)..i], &times[i..times.len().min(i + WINDOW)]);
        let is_back = stamps_s < -BACK_S;
        // Without neighbours that show the pace, any step ahead may be due to a fast pace.
        let pace = match pace(&[before, after]) {
            Some(pace) => pace.max(1.0),
            None if is_back => 1.0,
            None => return None,
        };
        let expected_s = pace * log_s;
        let varied_s = if pace > PACE_NEAR_1 { PACE_VARIES * expected_s } else { 0.0 };
        if !is_back && stamps_s <= expected_s + varied_s + AHEAD_S {
            return None;
        }
        let by_s = stamps_s - expected_s;
        let delay_s = |t: &Times| pace * since_s(t.log_ns, times[i].log_ns) - since_s(t.stamp_ns, times[i].stamp_ns);
        let delays_s = |part: &[Times]| median_high(&mut part.iter().map(delay_s).collect::<Vec<f64>>()).unwrap_or(0.0);
        // After a stall, the median delay is the same on both sides; after a step, it differs by the step.
        let stays = (delays_s(before) - delays_s(after)).abs() > 0.5 * by_s.abs();
        stays.then_some(Step { at_log_ns: times[i].log_ns, by_s })
    })
}

/// Pace of the stamps of `parts`, in s of the stamps for each s of the log; none if the log times do not advance.
fn pace(parts: &[&[Times]]) -> Option<f64> {
    let ends = parts.iter().filter_map(|part| Some((part.first()?, part.last()?)));
    let (stamps_s, log_s) = ends.fold((0.0, 0.0), |(stamps_s, log_s), (first, last)| {
        (stamps_s + since_s(last.stamp_ns, first.stamp_ns), log_s + since_s(last.log_ns, first.log_ns))
    });
    (log_s > 0.0).then_some(stamps_s / log_s)
}

/// Sentences about steps: one for each step, with all topics whose clocks made it.
fn step_notes(steps: &[(&str, Step)]) -> Vec<String> {
    // Each topic estimates the step from its own messages, so the estimates differ by jitter and pace.
    let alike = |a: &Step, b: &Step| (a.by_s - b.by_s).abs() <= 0.5 + 0.01 * a.by_s.abs();
    let mut groups: Vec<(&Step, Vec<&str>)> = Vec::new();
    for (topic, step) in steps {
        match groups.iter_mut().find(|(first, _)| alike(first, step)) {
            Some((_, topics)) => topics.push(topic),
            None => groups.push((step, vec![topic])),
        }
    }
    let note = |(step, topics): &(&Step, Vec<&str>)| {
        let way = if step.by_s < 0.0 { "back" } else { "ahead" };
        format!(
            "{}: header.stamp: expected a clock that runs on, got one that steps {way} by {:.3} s at log time {:.3} s: it was set while the bag was recorded; record again with a clock that does not step",
            topics.join(", "),
            step.by_s.abs(),
            step.at_log_ns as f64 * 1e-9
        )
    };
    groups.iter().map(note).collect()
}

/// Difference in s of the delays, from stamp to log, of a topic and of the `known` topic: the smallest difference apart
/// from a few outliers. Only messages that were logged at about the same time are compared, because a bag may have been
/// recorded from a replay at another rate.
fn offset_s(times: &[Times], known: &[Times]) -> Option<f64> {
    if times.len() < FEW || known.len() < FEW {
        return None;
    }
    // Both lists are sorted by log time: the nearest is one of two neighbours.
    let nearest = |t: &Times| {
        let next = known.partition_point(|k| k.log_ns < t.log_ns);
        let near = known[next.saturating_sub(1)..known.len().min(next + 1)].iter();
        let nearest = near.min_by_key(|k| k.log_ns.abs_diff(t.log_ns));
        let together = nearest.filter(|k| since_s(k.log_ns, t.log_ns).abs() <= TOGETHER_S);
        together.map(|k| t.delay_s() - k.delay_s())
    };
    let mut offsets: Vec<f64> = times.iter().filter_map(nearest).collect();
    offsets.sort_by(f64::total_cmp);
    if offsets.is_empty() {
        return None;
    }
    let [low, high] = [OUTLIERS, 1.0 - OUTLIERS].map(|q| quantile(&offsets, q, QuantileMethod::Nearest));
    // The difference nearest to zero: if most are positive it is the low end, if most are negative the high end.
    Some(if low > 0.0 { low } else { high.min(0.0) })
}

fn offset_note(topic: &str, offset_s: f64, reference: &str) -> Option<String> {
    let what = if offset_s > LATE_S {
        format!("stamps {offset_s:.3} s behind")
    } else if offset_s < -EARLY_S {
        format!("stamps {:.3} s ahead of", -offset_s)
    } else {
        return None;
    };
    Some(format!(
        "{topic}: header.stamp: expected the clock of {reference}, got {what} its, for messages that were logged together: two clocks that differ, such as a camera's own clock, or a slow node; stamp both with the host's clock and record again"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages at 100 Hz for 4 s. `at` maps a time to the log time and the stamp, all in ms.
    fn clocks(topic: &str, at: impl Fn(i64) -> (i64, i64), into: Clocks) -> Clocks {
        let mut clocks = into;
        let mut all: Vec<(i64, i64)> = (0..400).map(|i| at(1_000_000 + 10 * i)).collect();
        all.sort_unstable();
        for (log_ms, stamp_ms) in all {
            clocks.push(topic, 1_000_000 * log_ms, 1_000_000 * stamp_ms);
        }
        clocks
    }

    fn poses() -> Clocks {
        clocks("/pose", |t| (t + 2, t), Clocks::default())
    }

    #[test]
    fn a_clock_that_was_set_is_named_with_all_topics_that_it_stamps() {
        for (step_ms, words) in [(-3_600_000, "back by 3600.0"), (-400, "back by 0.4"), (900, "ahead by 0.9")] {
            let set = |t: i64| (t + 2, if t >= 1_002_000 { t + step_ms } else { t });
            let notes = clocks("/b", set, clocks("/pose", set, Clocks::default())).notes("/pose");
            assert!(notes.len() == 1 && notes[0].starts_with("/b, /pose: header.stamp"), "{notes:?}");
            assert!(notes[0].contains(words) && notes[0].contains("log time 1002.002 s"), "{notes:?}");
        }
        assert_eq!(poses().notes("/pose"), [] as [String; 0]);
    }

    #[test]
    fn a_recorder_that_stalls_or_loses_messages_sets_no_clock() {
        let late = |t: i64| if (1_001_000..1_003_000).contains(&t) { 1_003_000 + (t - 1_001_000) / 100 } else { t + 2 };
        assert_eq!(clocks("/pose", |t| (late(t), t), Clocks::default()).notes("/pose"), [] as [String; 0]);
        let lost = |t: i64| if t > 1_002_000 { t + 3000 } else { t };
        assert_eq!(clocks("/pose", |t| (lost(t) + 2, lost(t)), Clocks::default()).notes("/pose"), [] as [String; 0]);
        // A slow tracker, in a bag that was recorded from a replay at a quarter of the rate.
        let slow = clocks("/keypoints", |t| (4 * t + 150, t), clocks("/pose", |t| (4 * t, t), Clocks::default()));
        assert_eq!(slow.notes("/pose"), [] as [String; 0]);
    }

    #[test]
    fn stamps_that_run_faster_than_the_log_step_only_where_their_pace_does() {
        // A policy that acts twice a second and rests for 20 s between two episodes, with a pose every half second.
        let slowly = |t: i64| 1_000_000 + 50 * (t - 1_000_000);
        let rests = |t: i64| slowly(t) + if t >= 1_002_000 { 20_000 } else { 0 };
        for pace in [2, 5, 20] {
            let poses = clocks("/pose", |t| (slowly(t) / pace, slowly(t)), Clocks::default());
            let both = clocks("/action", |t| (rests(t) / pace, rests(t) + 7), poses);
            assert_eq!(both.notes("/pose"), [] as [String; 0], "{pace}");
            let set = |t: i64| (t / pace, if t >= 1_002_000 { t + 900 } else { t });
            let notes = clocks("/pose", set, Clocks::default()).notes("/pose");
            assert!(notes.len() == 1 && notes[0].contains("steps ahead by 0."), "{notes:?}");
        }
        let mut two = Clocks::default();
        two.push("/action", 1, 1);
        two.push("/action", 6_000_000_000, 11_000_000_000);
        assert_eq!(two.notes("/pose"), [] as [String; 0]);
    }

    #[test]
    fn clocks_that_differ_are_named_with_their_difference() {
        for (offset_ms, words) in [(-700, "0.7"), (300, "0.3"), (86_400_000, "86400.0"), (-1_700_000_000, "1700000.0")]
        {
            let both = clocks("/keypoints", |t| (t + 2, t + offset_ms), poses());
            let notes = both.notes("/pose");
            let way = if offset_ms < 0 { "s behind its" } else { "s ahead of its" };
            assert!(notes.len() == 1 && notes[0].starts_with("/keypoints: header.stamp"), "{notes:?}");
            assert!(notes[0].contains(way) && notes[0].contains(&format!("stamps {words}")), "{notes:?}");
        }
        assert_eq!(clocks("/keypoints", |t| (t + 120, t), poses()).notes("/pose"), [] as [String; 0]);
    }
}
