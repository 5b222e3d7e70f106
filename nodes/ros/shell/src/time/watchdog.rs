//! Watchdogs, deadlines and throttles. Pure; the caller passes the time.

use super::point::Time;
use std::time::Duration;

/// Watchdog that expires when it is not fed for a period.
///
/// It starts unfed. [`Watchdog::expired`] returns true only after a first [`Watchdog::feed`] and a later silence;
/// [`Watchdog::is_alive`] only while it is fed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Watchdog {
    period: Duration,
    fed: Option<Time>,
}

impl Watchdog {
    /// Creates a watchdog that tolerates a silence of `period`.
    #[must_use]
    pub fn new(period: Duration) -> Self {
        Self { period, fed: None }
    }

    /// Feeds the watchdog at `now`. A step back in time, as at the restart of a simulation, counts as fresh.
    pub fn feed(&mut self, now: Time) {
        self.fed = Some(now);
    }

    /// Returns the watchdog to its unfed state.
    pub fn reset(&mut self) {
        self.fed = None;
    }

    /// Returns true if it was fed at least once, and the last time is longer ago than the period.
    #[must_use]
    pub fn expired(&self, now: Time) -> bool {
        self.silence(now).is_some_and(|silence| silence > self.period)
    }

    /// Returns true if it was fed within the period.
    #[must_use]
    pub fn is_alive(&self, now: Time) -> bool {
        self.silence(now).is_some_and(|silence| silence <= self.period)
    }

    /// Returns the time since it was fed; `None` if it never was.
    #[must_use]
    pub fn silence(&self, now: Time) -> Option<Duration> {
        self.fed.map(|fed| now.saturating_since(fed))
    }

    /// Returns the tolerated silence.
    #[must_use]
    pub fn period(&self) -> Duration {
        self.period
    }
}

/// Deadline of a stream: counts its messages, and the gaps longer than the deadline.
#[derive(Clone, Debug, PartialEq)]
pub struct Deadline {
    watchdog: Watchdog,
    received: u64,
    missed: u64,
    window_start: Option<Time>,
    window_count: u64,
    rate_hz: f64,
}

impl Deadline {
    /// Creates the deadline of a stream with at most `period` between two messages.
    #[must_use]
    pub fn new(period: Duration) -> Self {
        Self {
            watchdog: Watchdog::new(period),
            received: 0,
            missed: 0,
            window_start: None,
            window_count: 0,
            rate_hz: 0.0,
        }
    }

    /// Counts a message that came at `now`.
    pub fn message(&mut self, now: Time) {
        if self.watchdog.expired(now) {
            self.missed += 1;
        }
        self.watchdog.feed(now);
        self.received += 1;
        self.window_count += 1;
    }

    /// Returns true if the stream has begun and is silent for longer than its deadline.
    #[must_use]
    pub fn expired(&self, now: Time) -> bool {
        self.watchdog.expired(now)
    }

    /// Returns the number of messages.
    #[must_use]
    pub fn received(&self) -> u64 {
        self.received
    }

    /// Returns the number of completed gaps longer than the deadline.
    #[must_use]
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Returns the messages per second, updated at most once per second.
    pub fn rate_hz(&mut self, now: Time) -> f64 {
        let Some(start) = self.window_start else {
            self.window_start = Some(now);
            return 0.0;
        };
        let elapsed_s = now.saturating_since(start).as_secs_f64();
        if elapsed_s >= 1.0 {
            self.rate_hz = self.window_count as f64 / elapsed_s;
            self.window_start = Some(now);
            self.window_count = 0;
        }
        self.rate_hz
    }
}

/// Throttle for warnings: lets one event pass per interval, and counts the others.
#[derive(Clone, Debug)]
pub struct Throttle {
    interval: Duration,
    passed: Option<Time>,
    held_back: u64,
}

impl Throttle {
    /// Creates a throttle that lets at most one event pass per interval.
    #[must_use]
    pub fn new(interval: Duration) -> Self {
        Self { interval, passed: None, held_back: 0 }
    }

    /// Tests an event at `now`. If it may pass, returns the number of events held back since the last pass.
    pub fn pass(&mut self, now: Time) -> Option<u64> {
        // After a step back of the clock an event passes, or the throttle would stay shut for as long as the step.
        let too_soon = self.passed.is_some_and(|passed| now >= passed && now.saturating_since(passed) < self.interval);
        if too_soon {
            self.held_back += 1;
            return None;
        }
        self.passed = Some(now);
        Some(std::mem::take(&mut self.held_back))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn a_watchdog_expires_only_after_a_first_feed() {
        let mut watchdog = Watchdog::new(Duration::from_millis(250));
        assert!(!watchdog.expired(at(10_000)));
        assert!(!watchdog.is_alive(at(10_000)));
        watchdog.feed(at(10_000));
        assert!(watchdog.is_alive(at(10_250)));
        assert!(!watchdog.expired(at(10_250)));
        assert!(watchdog.expired(at(10_251)));
        watchdog.feed(at(10_300));
        assert!(!watchdog.expired(at(10_500)));
        watchdog.reset();
        assert!(!watchdog.expired(at(99_999)));
    }

    #[test]
    fn a_step_back_in_time_does_not_expire_a_watchdog() {
        let mut watchdog = Watchdog::new(Duration::from_millis(250));
        watchdog.feed(at(10_000));
        assert!(!watchdog.expired(at(0)));
        assert_eq!(watchdog.silence(at(0)), Some(Duration::ZERO));
    }

    #[test]
    fn a_throttle_passes_one_event_per_interval_and_counts_the_rest() {
        let mut throttle = Throttle::new(Duration::from_secs(1));
        let passed: Vec<_> = [0, 100, 900, 1000, 1500, 5000].map(|millis| throttle.pass(at(millis))).into();
        assert_eq!(passed, [Some(0), None, None, Some(2), None, Some(1)]);
        assert_eq!(throttle.pass(at(0)), Some(0), "after a step back in time");
    }

    #[test]
    fn a_deadline_counts_long_gaps_once_each() {
        let mut stream = Deadline::new(Duration::from_millis(100));
        for millis in [0, 50, 100, 400, 450, 700] {
            stream.message(at(millis));
        }
        assert_eq!((stream.received(), stream.missed()), (6, 2));
        assert!(!stream.expired(at(800)));
        assert!(stream.expired(at(801)));
    }

    #[test]
    fn a_deadline_measures_the_rate_over_a_second() {
        let mut stream = Deadline::new(Duration::from_millis(100));
        assert_eq!(stream.rate_hz(at(0)), 0.0);
        for index in 0..60 {
            stream.message(at(index * 16));
        }
        assert!((stream.rate_hz(at(1000)) - 60.0).abs() < 1e-9);
        assert!((stream.rate_hz(at(1500)) - 60.0).abs() < 1e-9);
    }
}
