//! Points in time, in the clock that the node runs on.

use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

/// Nanoseconds since the epoch of the clock: Unix time, or the start of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time {
    nanos: i64,
}

impl Time {
    /// The epoch; under simulated time also "no /clock yet".
    pub const ZERO: Self = Self { nanos: 0 };

    /// From nanoseconds since the epoch.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self { nanos }
    }

    /// From seconds since the epoch, rounded to nanoseconds.
    #[must_use]
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self { nanos: (seconds * 1e9).round() as i64 }
    }

    /// Nanoseconds since the epoch.
    #[must_use]
    pub const fn nanos(self) -> i64 {
        self.nanos
    }

    /// Seconds since the epoch; a Unix time loses digits below 0.2 microseconds.
    #[must_use]
    pub fn as_secs_f64(self) -> f64 {
        self.nanos as f64 * 1e-9
    }

    /// The time since `earlier`, zero where that is later.
    #[must_use]
    pub fn saturating_since(self, earlier: Self) -> Duration {
        let nanos = i128::from(self.nanos) - i128::from(earlier.nanos);
        Duration::from_nanos(u64::try_from(nanos.max(0)).unwrap_or(u64::MAX))
    }

    /// Seconds from `earlier` to this, negative where that is later.
    #[must_use]
    pub fn secs_since(self, earlier: Self) -> f64 {
        (i128::from(self.nanos) - i128::from(earlier.nanos)) as f64 * 1e-9
    }
}

impl Add<Duration> for Time {
    type Output = Self;

    fn add(self, duration: Duration) -> Self {
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
