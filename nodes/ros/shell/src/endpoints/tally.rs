//! Tally of one subscription: counts of used, doubted and dropped messages, and the health that follows. Pure; the caller passes
//! the time.

use crate::process::health::Health;
use crate::time::point::Time;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Number of reports over which shares are computed: the last 5 s at one report per second.
const WINDOW_REPORTS: usize = 5;
/// Tolerated share of dropped or doubtful messages. Chosen: best-effort streams have a late message now and then.
const TOLERATED_SHARE: f64 = 0.01;
/// Time after the start of a node in which a silent topic is no error: discovery takes seconds on a busy machine.
const STARTUP: Duration = Duration::from_secs(5);
/// Maximum number of reasons in a problem's message. The values hold all of them.
const NAMED_REASONS: usize = 2;

/// Reason of a dropped or doubted message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Flaw {
    /// Field or property at fault, for example `encoding`. Messages are counted by it.
    pub kind: &'static str,
    /// Fault of this message in words: expected and received value.
    pub detail: String,
}

impl Flaw {
    /// Creates the flaw of a message.
    #[must_use]
    pub fn new(kind: &'static str, detail: impl ToString) -> Self {
        Self { kind, detail: detail.to_string() }
    }
}

/// Names of a topic's messages in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Names {
    /// Singular, for example `image`. The key of the rate begins with it.
    pub one: &'static str,
    /// Plural, for example `images`. The keys of the counts begin with it.
    pub many: &'static str,
}

/// Moment in two clocks.
///
/// A slow simulation stretches the gaps of a stream in wall time, a fast one in simulated time. The shorter of the two gaps counts
/// as silence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Moment {
    /// Time since the start of the node, in a clock that never steps.
    pub uptime: Duration,
    /// Time of the node's clock.
    pub clock: Time,
}

impl Moment {
    fn since(self, earlier: Self) -> Duration {
        self.uptime.saturating_sub(earlier.uptime).min(self.clock.saturating_since(earlier.clock))
    }
}

/// Discovered publishers of a topic.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Publishers {
    /// Number of publishers with a type and a profile that fit the subscription.
    pub fitting: usize,
    /// Reason for each publisher that the subscription does not hear.
    pub unheard: Vec<String>,
}

/// Counts of one kind of flaw.
#[derive(Debug, Clone, Default)]
struct Flawed {
    dropped: u64,
    doubted: u64,
    detail: String,
}

/// Counts of the period of one report.
#[derive(Debug, Clone, Default)]
struct Period {
    received: u64,
    dropped: BTreeMap<&'static str, u64>,
    doubted: BTreeMap<&'static str, u64>,
}

/// Tally of one subscription.
#[derive(Debug, Clone)]
pub(crate) struct Tally {
    names: Option<Names>,
    patience: Duration,
    since: Moment,
    needed: Option<Moment>,
    heard: Option<Moment>,
    received: u64,
    flaws: BTreeMap<&'static str, Flawed>,
    period: Period,
    window: VecDeque<Period>,
    reported: Duration,
}

/// Findings of one report.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Findings {
    pub problems: Vec<(Health, String)>,
    pub values: Vec<(String, String)>,
}

impl Tally {
    /// Creates the tally of a subscription at `now`. While its topic is needed, a silence of `patience` is tolerated. Without names
    /// only unheard publishers are reported.
    pub fn new(names: Option<Names>, patience: Duration, now: Moment) -> Self {
        Self {
            names,
            patience,
            since: now,
            needed: None,
            heard: None,
            received: 0,
            flaws: BTreeMap::new(),
            period: Period::default(),
            window: VecDeque::new(),
            reported: now.uptime,
        }
    }

    /// Sets whether the node needs the topic. Silence counts from the beginning of the need.
    pub fn need(&mut self, needed: bool, now: Moment) {
        match (needed, self.needed) {
            (true, None) => self.needed = Some(now),
            (false, Some(_)) => self.needed = None,
            _ => {}
        }
    }

    /// Returns true while the node needs the topic.
    pub fn is_needed(&self) -> bool {
        self.needed.is_some()
    }

    /// Counts a message. `flaw` is the reason of a drop.
    pub fn message(&mut self, now: Moment, flaw: Option<&Flaw>) {
        self.heard = Some(now);
        self.received += 1;
        self.period.received += 1;
        if let Some(flaw) = flaw {
            *self.period.dropped.entry(flaw.kind).or_default() += 1;
            let flawed = self.flaws.entry(flaw.kind).or_default();
            flawed.dropped += 1;
            flawed.detail.clone_from(&flaw.detail);
        }
    }

    /// Counts a flaw of a message that is used nevertheless.
    pub fn doubt(&mut self, flaw: &Flaw) {
        *self.period.doubted.entry(flaw.kind).or_default() += 1;
        let flawed = self.flaws.entry(flaw.kind).or_default();
        flawed.doubted += 1;
        flawed.detail.clone_from(&flaw.detail);
    }

    /// Ends the period of a report, and returns the problems of the last periods.
    pub fn report(&mut self, topic: &str, publishers: &Publishers, now: Moment) -> Findings {
        let elapsed_s = now.uptime.saturating_sub(self.reported).as_secs_f64();
        self.reported = now.uptime;
        let rate_hz = if elapsed_s > 0.0 { self.period.received as f64 / elapsed_s } else { 0.0 };
        self.window.push_back(std::mem::take(&mut self.period));
        if self.window.len() > WINDOW_REPORTS {
            self.window.pop_front();
        }
        let mut found = Findings::default();
        for why in &publishers.unheard {
            found.problems.push((Health::Warn, format!("a publisher of {topic} is not heard: {why}")));
        }
        let Some(names) = self.names else { return found };
        found.problems.extend(self.losses(names));
        found.problems.extend(self.silence(names, topic, publishers, now));
        self.values(names, rate_hz, &mut found.values);
        found
    }

    /// Returns the problems of dropped and doubtful messages in the window.
    fn losses(&self, names: Names) -> Vec<(Health, String)> {
        let received: u64 = self.window.iter().map(|period| period.received).sum();
        let mut problems = Vec::new();
        let dropped = sum(self.window.iter().map(|period| &period.dropped));
        let count: u64 = dropped.values().sum();
        let (many, why) = (names.many, self.reasons(&dropped));
        if count > 0 && count >= received {
            // An idle node may receive a stream that it cannot use. That is no error until it needs the stream.
            let health = if self.is_needed() { Health::Error } else { Health::Warn };
            problems.push((health, format!("all {count} {many} of the last {WINDOW_REPORTS} s were dropped: {why}")));
        } else if is_many(count, received) {
            let text = format!("{count} of {received} {many} of the last {WINDOW_REPORTS} s were dropped: {why}");
            problems.push((Health::Warn, text));
        }
        let doubted = sum(self.window.iter().map(|period| &period.doubted));
        let count: u64 = doubted.values().sum();
        if is_many(count, received) {
            let why = self.reasons(&doubted);
            problems.push((Health::Warn, format!("{count} of {received} {many} are doubtful: {why}")));
        }
        problems
    }

    /// Returns the most frequent kinds of flaws, each with its newest detail.
    fn reasons(&self, counts: &BTreeMap<&'static str, u64>) -> String {
        let mut kinds: Vec<_> = counts.iter().collect();
        kinds.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let details = kinds.iter().take(NAMED_REASONS).filter_map(|(kind, _)| Some(&self.flaws.get(*kind)?.detail[..]));
        details.collect::<Vec<_>>().join(", and ")
    }

    /// Returns the problem of a needed topic that is silent.
    fn silence(&self, names: Names, topic: &str, publishers: &Publishers, now: Moment) -> Option<(Health, String)> {
        let needed = self.needed?;
        let silent = now.since(self.heard.unwrap_or(needed));
        // The wall time of the start alone: discovery does not wait for a simulation.
        let is_starting = self.heard.is_none() && now.uptime.saturating_sub(self.since.uptime) < STARTUP;
        if is_starting || silent.min(now.since(needed)) <= self.patience {
            return None;
        }
        let many = names.many;
        let what = match self.heard {
            Some(_) => format!("no {many} on {topic} for {:.1} s", silent.as_secs_f64()),
            None => format!("no {many} on {topic} yet"),
        };
        let why = match (publishers.fitting, publishers.unheard.len()) {
            (0, 0) => "nobody publishes it".to_owned(),
            (0, _) => "its publishers do not fit".to_owned(),
            (1, _) => "its publisher is silent".to_owned(),
            (n, _) => format!("its {n} publishers are silent"),
        };
        Some((Health::Error, format!("{what}: {why}")))
    }

    fn values(&self, names: Names, rate_hz: f64, values: &mut Vec<(String, String)>) {
        let Names { one, many } = names;
        let dropped: u64 = self.flaws.values().map(|flawed| flawed.dropped).sum();
        values.push((format!("{one}_rate_hz"), format!("{rate_hz:.1}")));
        values.push((format!("{many}_received"), self.received.to_string()));
        values.push((format!("{many}_dropped"), dropped.to_string()));
        for (kind, flawed) in &self.flaws {
            let kind = kind.replace(' ', "_");
            let counts = [("dropped", flawed.dropped), ("doubtful", flawed.doubted)];
            for (how, count) in counts.into_iter().filter(|(_, count)| *count > 0) {
                values.push((format!("{many}_{how}_for_{kind}"), count.to_string()));
            }
        }
    }
}

fn is_many(count: u64, received: u64) -> bool {
    count as f64 > TOLERATED_SHARE * received as f64
}

fn sum<'a>(counts: impl Iterator<Item = &'a BTreeMap<&'static str, u64>>) -> BTreeMap<&'static str, u64> {
    let mut total = BTreeMap::new();
    for (kind, count) in counts.flatten() {
        *total.entry(*kind).or_default() += count;
    }
    total
}

#[cfg(test)]
mod tests;
