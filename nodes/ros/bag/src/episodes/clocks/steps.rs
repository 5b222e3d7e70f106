//! Steps of a clock that was set while it stamped a topic, told apart from stalls of a publisher or of the recorder.
//!
//! A stall makes messages late, and the delay returns to the least one of the time before. A clock that was set changes the
//! least delay for good. A stall that the recording begins with looks like a step, and is not named.

use super::times::{Times, since_s};
use catenary_core::statistics::median_high;
use std::collections::VecDeque;

/// Backward step of the stamps in s above which a clock was set. Messages of one publisher overtake each other by less.
const BACK_S: f64 = 0.1;
/// Step of the stamps ahead of the log times in s above which a clock was set.
const AHEAD_S: f64 = 0.5;
/// Number of messages on either side of a step that show the pace and the usual delay.
const WINDOW: usize = 10;
/// Pace of the stamps below which they run with the log times: the jitter of a clock that is not simulated is smaller.
const PACE_NEAR_1: f64 = 1.05;
/// Share by which a faster pace may vary over a gap: the pace of a simulation depends on its load.
const PACE_VARIES: f64 = 0.1;
/// Factor between the paces on both sides of a step up to which both are one pace. A backlog that a stall left is logged
/// many times as fast as it was sent.
const ONE_PACE: f64 = 1.5;
/// Log time in s on either side of a step over which the least delay is taken. A backlog takes less time.
const LEVEL_S: f64 = 30.0;
/// Least log time in s before a step: the messages of a shorter one may all be late.
const LEAST_BEFORE_S: f64 = 1.0;
/// Length in ns of the intervals of log time whose least delay is kept.
const BUCKET_NS: i64 = 1_000_000_000;
/// Greatest number of steps that wait for the time after them.
const MOST_DOUBTED: usize = 16;

/// Step of a clock that was set while it stamped a topic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    at_log_ns: i64,
    by_s: f64,
}

/// Step that the messages next to it show, with the least delays in s before it and since.
#[derive(Debug)]
struct Doubted {
    step: Step,
    before_s: f64,
    after_s: f64,
}

impl Doubted {
    /// True if the least delay changed by the step.
    fn stays(&self) -> bool {
        (self.before_s - self.after_s).abs() > 0.5 * self.step.by_s.abs()
    }
}

/// Search for the first step of a topic's clock, relative to its pace.
///
/// The pace is not 1 for a bag that was recorded from simulated time or from a faster replay.
#[derive(Debug, Default)]
pub(super) struct Steps {
    /// Newest messages: up to [`WINDOW`] before and after the one that is looked at.
    recent: VecDeque<Times>,
    /// Index in `recent` of the next message to look at.
    next: usize,
    first: Option<Times>,
    /// Number of each interval of log time, and the least delay in s in it, for the last [`LEVEL_S`].
    levels: VecDeque<(i64, f64)>,
    doubted: Vec<Doubted>,
    found: Option<Step>,
}

impl Steps {
    /// Adds a message, in order of log time.
    pub(super) fn push(&mut self, times: Times) {
        if self.found.is_some() {
            return;
        }
        self.first.get_or_insert(times);
        self.recent.push_back(times);
        // The message with WINDOW messages from itself on can be looked at.
        while self.found.is_none() && self.recent.len() >= self.next + WINDOW {
            self.look();
        }
    }

    /// First step that is no stall. Nothing may be added afterwards.
    pub(super) fn first(&mut self) -> Option<Step> {
        while self.found.is_none() && self.next < self.recent.len() {
            self.look();
        }
        self.found.or_else(|| self.doubted.iter().find(|doubted| doubted.stays()).map(|doubted| doubted.step))
    }

    /// Looks at the next message.
    fn look(&mut self) {
        let i = self.next;
        self.recent.make_contiguous();
        let (recent, _) = self.recent.as_slices();
        let times = recent[i];
        let first = self.first.unwrap_or(times);
        let candidate = (i > 0).then(|| candidate(recent, i, first)).flatten();
        self.settle(times);
        if let Some((step, is_paced)) = candidate {
            let before_s = self.levels.iter().map(|(_, delay_s)| *delay_s).min_by(f64::total_cmp);
            let known_s = since_s(times.log_ns, first.log_ns);
            match before_s {
                // A faster pace changes the delay all the time: the messages next to the step must do.
                _ if is_paced => self.found = Some(step),
                Some(before_s)
                    if self.doubted.len() < MOST_DOUBTED && (step.by_s < 0.0 || known_s >= LEAST_BEFORE_S) =>
                {
                    self.doubted.push(Doubted { step, before_s, after_s: times.delay_s() });
                    // The time before ends here: a second step is measured from the first.
                    self.levels.clear();
                }
                _ => {}
            }
        }
        let (bucket, delay_s) = (times.log_ns.div_euclid(BUCKET_NS), times.delay_s());
        match self.levels.back_mut().filter(|(last, _)| *last == bucket) {
            Some((_, least_s)) => *least_s = least_s.min(delay_s),
            None => self.levels.push_back((bucket, delay_s)),
        }
        let oldest = bucket.saturating_sub((LEVEL_S * 1e9) as i64 / BUCKET_NS);
        while self.levels.front().is_some_and(|(bucket, _)| *bucket < oldest) {
            self.levels.pop_front();
        }
        if i == WINDOW {
            self.recent.pop_front();
        } else {
            self.next += 1;
        }
    }

    /// Adds a message to the time after the doubted steps, and decides on those that are long over.
    fn settle(&mut self, times: Times) {
        for doubted in &mut self.doubted {
            doubted.after_s = doubted.after_s.min(times.delay_s());
        }
        let is_over = |d: &Doubted| since_s(times.log_ns, d.step.at_log_ns) > LEVEL_S;
        while let Some(first) = self.doubted.first().filter(|first| is_over(first)) {
            if first.stays() {
                self.found = Some(first.step);
                return;
            }
            self.doubted.remove(0);
        }
    }
}

/// Step at message `i` by the messages next to it, and true if the stamps run at another pace than the log times. `first` is
/// the first message of the topic.
fn candidate(times: &[Times], i: usize, first: Times) -> Option<(Step, bool)> {
    let stamps_s = since_s(times[i].stamp_ns, times[i - 1].stamp_ns);
    let log_s = since_s(times[i].log_ns, times[i - 1].log_ns);
    let (before, after) = (&times[i.saturating_sub(WINDOW)..i], &times[i..times.len().min(i + WINDOW)]);
    let is_back = stamps_s < -BACK_S;
    // Without neighbours that show the pace, any step ahead may be due to a fast pace.
    let found = match common_pace(before, after, first) {
        Some(pace) => pace,
        None if is_back => 1.0,
        None => return None,
    };
    let pace = found.max(1.0);
    let expected_s = pace * log_s;
    let varied_s = if pace > PACE_NEAR_1 { PACE_VARIES * expected_s } else { 0.0 };
    let is_paced = pace > PACE_NEAR_1 || found * PACE_NEAR_1 < 1.0;
    if !is_back && stamps_s <= expected_s + varied_s + AHEAD_S {
        return None;
    }
    let by_s = stamps_s - expected_s;
    let delay_s = |t: &Times| pace * since_s(t.log_ns, times[i].log_ns) - since_s(t.stamp_ns, times[i].stamp_ns);
    let delays_s = |part: &[Times]| median_high(&mut part.iter().map(delay_s).collect::<Vec<f64>>()).unwrap_or(0.0);
    // One message that is late changes no median.
    let stays = (delays_s(before) - delays_s(after)).abs() > 0.5 * by_s.abs();
    stays.then_some((Step { at_log_ns: times[i].log_ns, by_s }, is_paced))
}

/// Pace of the stamps on both sides of a step, in s of the stamps for each s of the log; 1 if the sides differ from one
/// another or from the time before, as around a stall. None if the log times do not advance.
fn common_pace(before: &[Times], after: &[Times], first: Times) -> Option<f64> {
    let both = pace(&[before, after])?;
    let is_other = |part: &[Times]| pace(&[part]).is_some_and(|own| own > ONE_PACE * both || both > ONE_PACE * own);
    let long = [Some(first), before.last().copied()].into_iter().flatten().collect::<Vec<Times>>();
    Some(if is_other(before) || is_other(after) || is_other(&long) { 1.0 } else { both })
}

/// Pace of the stamps of `parts`; none if the log times do not advance.
fn pace(parts: &[&[Times]]) -> Option<f64> {
    let ends = parts.iter().filter_map(|part| Some((part.first()?, part.last()?)));
    let (stamps_s, log_s) = ends.fold((0.0, 0.0), |(stamps_s, log_s), (first, last)| {
        (stamps_s + since_s(last.stamp_ns, first.stamp_ns), log_s + since_s(last.log_ns, first.log_ns))
    });
    (log_s > 0.0).then_some(stamps_s / log_s)
}

/// Sentences about steps: one for each step, with all topics whose clocks made it.
pub(super) fn notes(steps: &[(&str, Step)]) -> Vec<String> {
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
