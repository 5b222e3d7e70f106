//! Tally of one subscription: messages used, doubted and dropped, and the health that follows. Pure; the caller brings
//! the time.

use crate::diagnostics::Health;
use crate::time::Time;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Reports over which shares are taken: at one report a second, the last 5 s.
const WINDOW_REPORTS: usize = 5;
/// Share of dropped or doubtful messages that is tolerated; best-effort streams have a late message now and then.
const TOLERATED_SHARE: f64 = 0.01;
/// Time after the start of a node in which a topic need not be heard: discovery takes seconds on a busy machine.
const STARTUP: Duration = Duration::from_secs(5);
/// Reasons that a message names; all are among the values.
const NAMED_REASONS: usize = 2;

/// Reason for which a message is dropped or doubted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Flaw {
    /// Field or property at fault, as in `encoding`; messages are counted by it.
    pub kind: &'static str,
    /// Fault of this message, in words: expected and received value.
    pub detail: String,
}

impl Flaw {
    /// Flaw of one message.
    #[must_use]
    pub fn new(kind: &'static str, detail: impl ToString) -> Self {
        Self { kind, detail: detail.to_string() }
    }
}

/// Names of a topic's messages in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Names {
    /// Singular, as in `image`; the key of the rate begins with it.
    pub one: &'static str,
    /// Plural, as in `images`; the keys of the counts begin with it.
    pub many: &'static str,
}

/// Moment in two clocks.
///
/// A slow simulation stretches the gaps of a stream in wall time, a fast one in simulated time. The shorter of the two
/// gaps is the silence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Moment {
    /// Time since the node began, in a clock that does not step.
    pub uptime: Duration,
    /// Node's clock.
    pub clock: Time,
}

impl Moment {
    fn since(self, earlier: Self) -> Duration {
        self.uptime.saturating_sub(earlier.uptime).min(self.clock.saturating_since(earlier.clock))
    }
}

/// Publishers of a topic, as discovery knows them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Publishers {
    /// Publishers whose type and profile fit the subscription.
    pub fitting: usize,
    /// Reason for each publisher that the subscription does not hear.
    pub unheard: Vec<String>,
}

/// Messages of a flaw's kind.
#[derive(Debug, Clone, Default)]
struct Flawed {
    dropped: u64,
    doubted: u64,
    detail: String,
}

/// Counts of one report's period.
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
    /// Tally of a subscription made at `now`, which tolerates a silence of `patience` while its topic is needed. Without
    /// names, only publishers that are not heard are reported.
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

    /// Sets whether the node needs the topic. Silence counts from the moment at which the need began.
    pub fn need(&mut self, needed: bool, now: Moment) {
        match (needed, self.needed) {
            (true, None) => self.needed = Some(now),
            (false, Some(_)) => self.needed = None,
            _ => {}
        }
    }

    /// Whether the node needs the topic.
    pub fn is_needed(&self) -> bool {
        self.needed.is_some()
    }

    /// Counts a message; `flaw`: the reason for which it is dropped.
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

    /// Counts a flaw of a message that is used all the same.
    pub fn doubt(&mut self, flaw: &Flaw) {
        *self.period.doubted.entry(flaw.kind).or_default() += 1;
        let flawed = self.flaws.entry(flaw.kind).or_default();
        flawed.doubted += 1;
        flawed.detail.clone_from(&flaw.detail);
    }

    /// Ends the period of a report, and finds what is wrong with the last few.
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

    /// Shares of dropped and doubtful messages in the window.
    fn losses(&self, names: Names) -> Vec<(Health, String)> {
        let received: u64 = self.window.iter().map(|period| period.received).sum();
        let mut problems = Vec::new();
        let dropped = sum(self.window.iter().map(|period| &period.dropped));
        let count: u64 = dropped.values().sum();
        let (many, why) = (names.many, self.reasons(&dropped));
        if count > 0 && count >= received {
            // Idle nodes may hear a stream that they cannot use: no error until they need it.
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

    /// Most frequent kinds of flaws, each with its newest detail.
    fn reasons(&self, counts: &BTreeMap<&'static str, u64>) -> String {
        let mut kinds: Vec<_> = counts.iter().collect();
        kinds.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let details = kinds.iter().take(NAMED_REASONS).filter_map(|(kind, _)| Some(&self.flaws.get(*kind)?.detail[..]));
        details.collect::<Vec<_>>().join(", and ")
    }

    /// Silence of a topic that is needed.
    fn silence(&self, names: Names, topic: &str, publishers: &Publishers, now: Moment) -> Option<(Health, String)> {
        let needed = self.needed?;
        let silent = now.since(self.heard.unwrap_or(needed));
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
