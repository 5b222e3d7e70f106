//! Points in time of a node's clock.

use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

/// Point in time, nanoseconds since the epoch of the clock: Unix time, or the start of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time {
    nanos: i64,
}

impl Time {
    /// Epoch. In simulated time also the time before the first `/clock`.
    pub const ZERO: Self = Self { nanos: 0 };

    /// Converts from nanoseconds since the epoch.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self { nanos }
    }

    /// Converts from seconds since the epoch, rounded to nanoseconds.
    #[must_use]
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self { nanos: (seconds * 1e9).round() as i64 }
    }

    /// Returns the nanoseconds since the epoch.
    #[must_use]
    pub const fn nanos(self) -> i64 {
        self.nanos
    }

    /// Returns the seconds since the epoch. A Unix time loses digits below 0.2 microseconds.
    #[must_use]
    pub fn as_secs_f64(self) -> f64 {
        self.nanos as f64 * 1e-9
    }

    /// Returns the time since `earlier`, zero if `earlier` is later.
    #[must_use]
    pub fn saturating_since(self, earlier: Self) -> Duration {
        // In 128 bits: stamps of strangers may lie at both ends of the range.
        let nanos = i128::from(self.nanos) - i128::from(earlier.nanos);
        Duration::from_nanos(u64::try_from(nanos.max(0)).unwrap_or(u64::MAX))
    }

    /// Returns the seconds since `earlier`, negative if `earlier` is later.
    #[must_use]
    pub fn secs_since(self, earlier: Self) -> f64 {
        (i128::from(self.nanos) - i128::from(earlier.nanos)) as f64 * 1e-9
    }
}

impl Add<Duration> for Time {
    type Output = Self;

    fn add(self, duration: Duration) -> Self {
        // `Duration::MAX` stands for no limit, and must not overflow.
        let nanos = i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX);
        Self { nanos: self.nanos.saturating_add(nanos) }
    }
}

impl Sub<Duration> for Time {
    type Output = Self;

    fn sub(self, duration: Duration) -> Self {
        let nanos = i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX);
        Self { nanos: self.nanos.saturating_sub(nanos) }
    }
}

impl fmt::Display for Time {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, nanos) = (self.nanos.div_euclid(1_000_000_000), self.nanos.rem_euclid(1_000_000_000));
        write!(formatter, "{seconds}.{nanos:09}")
    }
}
