//! What is replayed, and how.

use crate::error::BagError;
use crate::filter::TopicFilter;
use crate::overrides::QosOverrides;
use crate::reader::{BagReader, Topic};
use std::path::PathBuf;
use std::time::Duration;

/// Least and greatest finite speed.
const RATES: [f64; 2] = [1e-3, 1e6];
/// Least and greatest rate of `/clock` in Hz.
const CLOCK_RATES: [f64; 2] = [0.1, 10_000.0];

/// What is replayed, and how.
#[derive(Debug, Clone)]
pub struct ReplaySettings {
    /// Bag folder or file.
    pub bag: PathBuf,
    /// Topics of the bag. Where it chooses none: all, less what it excludes.
    pub filter: TopicFilter,
    /// Speed, default 1; larger is faster, infinite as fast as subscribers can take it: 5000 messages and 100 MB a second.
    pub rate: f64,
    /// s of the bag to skip, default 0.
    pub start_offset_s: f64,
    /// s of the bag to play, default all, and so where it is less than zero.
    pub duration_s: Option<f64>,
    /// s to wait before the bag, each time, default 0.
    pub delay_s: f64,
    /// Whether to begin anew at the end, default no.
    pub repeat: bool,
    /// Whether to publish `/clock` in step with the bag instead of what the bag has of it, and how often, Hz of wall time;
    /// default no.
    pub clock_hz: Option<f64>,
    /// Profiles other than those that the bag says were offered.
    pub overrides: QosOverrides,
    /// Whether to replay commands, too, where no arm or a simulated one follows them, default no.
    pub allow_replay: bool,
    /// Whether to replay what an arm and a camera measure where others publish it, too, default no.
    pub allow_others: bool,
    /// How long to wait until every topic has a subscriber, default 2 s. Replaying begins in any case.
    pub wait: Duration,
}

impl ReplaySettings {
    /// How often `/clock` is published where nobody says otherwise, Hz.
    pub const CLOCK_HZ: f64 = 200.0;

    /// The whole bag once, at its own speed, without commands.
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

    /// Opens the bag, having checked the numbers.
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

    /// Whether a topic of the bag is replayed.
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
