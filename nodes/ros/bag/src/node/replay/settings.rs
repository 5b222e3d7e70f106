//! Settings of a replay.

use crate::error::BagError;
use crate::filter::TopicFilter;
use crate::node::overrides::QosOverrides;
use crate::reader::{BagReader, Topic};
use std::path::PathBuf;
use std::time::Duration;

/// Least and greatest finite speed.
const RATES: [f64; 2] = [1e-3, 1e6];
/// Least and greatest rate of `/clock` in Hz.
const CLOCK_RATES: [f64; 2] = [0.1, 10_000.0];

/// Settings of a replay: topics, speed, range and safety.
#[derive(Debug, Clone)]
pub struct ReplaySettings {
    /// Bag folder or file.
    pub bag: PathBuf,
    /// Topics of the bag. A filter that chooses none means all topics without the excluded ones.
    pub filter: TopicFilter,
    /// Speed, default 1. A larger value is faster; infinite means 5000 messages and 100 MB a second, which subscribers
    /// can follow.
    pub rate: f64,
    /// Part of the bag to skip in s, default 0.
    pub start_offset_s: f64,
    /// Part of the bag to play in s; none or a negative value, the default, means all.
    pub duration_s: Option<f64>,
    /// Time to wait before each pass through the bag in s, default 0.
    pub delay_s: f64,
    /// True to begin anew at the end, default false.
    pub repeat: bool,
    /// Rate in Hz of wall time at which `/clock` is published in step with the bag, in place of a recorded `/clock`;
    /// none, the default, publishes none.
    pub clock_hz: Option<f64>,
    /// Overrides of the recorded profiles.
    pub overrides: QosOverrides,
    /// True to replay commands, too, if no arm or a simulated arm follows them, default false.
    pub allow_replay: bool,
    /// True to replay measurements of an arm and a camera even if other nodes publish them, too, default false.
    pub allow_others: bool,
    /// Greatest time to wait until every topic has a subscriber, default 2 s. The replay begins in any case.
    pub wait: Duration,
}

impl ReplaySettings {
    /// Default rate of `/clock` in Hz.
    pub const CLOCK_HZ: f64 = 200.0;

    /// Settings that play the whole bag once, at its own speed, without commands.
    #[must_use]
    pub fn new(bag: PathBuf) -> Self {
        Self {
            bag,
            filter: TopicFilter::default(),
            rate: 1.0,
            start_offset_s: 0.0,
            duration_s: None,
            delay_s: 0.0,
            repeat: false,
            clock_hz: None,
            overrides: QosOverrides::default(),
            allow_replay: false,
            allow_others: false,
            wait: Duration::from_secs(2),
        }
    }

    /// Checks the settings and opens the bag.
    ///
    /// # Errors
    /// [`BagError::Setting`], and those of [`BagReader::open`].
    pub fn open(&self) -> Result<BagReader, BagError> {
        self.check()?;
        let bag = BagReader::open(&self.bag)?;
        let span_s = bag.span_ns().map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9);
        if self.start_offset_s > span_s {
            let expected = format!("at most the {span_s:.3} s of the bag");
            let got = format!("{:?}", self.start_offset_s);
            return Err(BagError::Setting { name: "start_offset_s", expected, got });
        }
        for name in self.filter.topics.iter().filter(|name| !name.ends_with('*')) {
            let absolute = format!("/{}", name.trim_start_matches('/'));
            if bag.topic(&absolute).is_none() {
                let expected = format!("topics of the bag, which has {}", bag.describe_topics());
                return Err(BagError::Setting { name: "topics", expected, got: format!("{name:?}") });
            }
        }
        Ok(bag)
    }

    fn check(&self) -> Result<(), BagError> {
        self.filter.check()?;
        let wrong = |name, expected: &str, got: f64| {
            Err(BagError::Setting { name, expected: expected.to_owned(), got: format!("{got:?}") })
        };
        let [slowest, fastest] = RATES;
        if !(self.rate == f64::INFINITY || (slowest..=fastest).contains(&self.rate)) {
            return wrong("rate", &format!("a number from {slowest} to {fastest}, or inf"), self.rate);
        }
        let [rare, frequent] = CLOCK_RATES;
        if let Some(hz) = self.clock_hz.filter(|hz| !(rare..=frequent).contains(hz)) {
            return wrong("clock", &format!("a number from {rare} to {frequent} Hz"), hz);
        }
        let duration_s = self.duration_s.map_or(0.0, |s| if s < 0.0 { 0.0 } else { s });
        for (name, seconds) in
            [("start_offset_s", self.start_offset_s), ("playback_duration_s", duration_s), ("delay_s", self.delay_s)]
        {
            if !seconds.is_finite() || seconds < 0.0 {
                return wrong(name, "a number of at least zero", seconds);
            }
        }
        Ok(())
    }

    /// True if a topic of the bag is replayed.
    pub(super) fn takes(&self, topic: &Topic) -> bool {
        let (names, kind) = ([topic.name.as_str()], &topic.type_name);
        if self.filter.chooses() { self.filter.takes(&names, kind) } else { !self.filter.excludes(&names, kind) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_negative_duration_is_none_and_a_negative_offset_is_refused() {
        let settings = ReplaySettings::new("bag".into());
        for seconds in [-1.0, f64::NEG_INFINITY, 0.0, 3.5] {
            ReplaySettings { duration_s: Some(seconds), ..settings.clone() }.check().unwrap();
        }
        let wrong = ReplaySettings { duration_s: Some(f64::NAN), ..settings.clone() }.check().unwrap_err().to_string();
        assert!(wrong.starts_with("playback_duration_s: expected a number"), "{wrong}");
        assert!(ReplaySettings { start_offset_s: -1.0, ..settings }.check().is_err());
    }
}
