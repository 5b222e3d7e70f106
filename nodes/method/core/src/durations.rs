//! Histogram of short durations, counted without an allocation.

use std::time::Duration;

/// Number of bins: a bin is one microsecond, and the last one holds all that take longer.
const BINS: usize = 2000;

/// Histogram of durations in microseconds.
#[derive(Debug, Clone, PartialEq)]
pub struct Durations {
    count: u64,
    longest: Duration,
    bins: Box<[u32; BINS]>,
}

impl Default for Durations {
    fn default() -> Self {
        Self { count: 0, longest: Duration::ZERO, bins: Box::new([0; BINS]) }
    }
}

impl Durations {
    /// Adds a duration.
    pub fn add(&mut self, duration: Duration) {
        self.count += 1;
        self.longest = self.longest.max(duration);
        let bin = usize::try_from(duration.as_micros()).unwrap_or(BINS - 1).min(BINS - 1);
        self.bins[bin] += 1;
    }

    /// Returns the number of durations.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the longest duration.
    #[must_use]
    pub fn longest(&self) -> Duration {
        self.longest
    }

    /// Returns the duration that this share of them does not exceed, in whole microseconds, rounded down; `None` without one. Durations
    /// beyond the last bin count as 1999 us.
    #[must_use]
    pub fn quantile_us(&self, share: f64) -> Option<usize> {
        let mut seen = 0;
        self.bins.iter().position(|n| {
            seen += u64::from(*n);
            self.count > 0 && seen as f64 >= share * self.count as f64
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_read_from_the_histogram() {
        let mut durations = Durations::default();
        assert_eq!(durations.quantile_us(0.5), None);
        (0..100).for_each(|us| durations.add(Duration::from_micros(us)));
        durations.add(Duration::from_millis(5));
        assert_eq!(durations.quantile_us(0.5), Some(50));
        assert_eq!(durations.quantile_us(0.99), Some(99));
        assert_eq!(durations.quantile_us(1.0), Some(1999));
        assert_eq!((durations.count(), durations.longest()), (101, Duration::from_millis(5)));
    }
}
