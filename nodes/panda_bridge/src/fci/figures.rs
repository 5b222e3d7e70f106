//! Figures of the control loop, counted without an allocation.

use std::time::Duration;

/// Number of histogram bins; a bin is one microsecond, and the last one holds all that take longer.
const BINS: usize = 1000;

/// Histogram of the computing times, and counts of cycles.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopFigures {
    /// Cycles of all motions.
    pub cycles: u64,
    /// States that did not arrive, by the robot's clock.
    pub lost_states: u64,
    /// Longest computing time of a cycle.
    pub longest: Duration,
    bins: Box<[u32; BINS]>,
}

impl Default for LoopFigures {
    fn default() -> Self {
        Self { cycles: 0, lost_states: 0, longest: Duration::ZERO, bins: Box::new([0; BINS]) }
    }
}

impl LoopFigures {
    /// Adds a cycle: its computing time, and the time between its state and the last one by the robot's clock, ms.
    pub fn add(&mut self, computing: Duration, period_ms: u64) {
        self.cycles += 1;
        self.lost_states += period_ms.saturating_sub(1);
        self.longest = self.longest.max(computing);
        let bin = usize::try_from(computing.as_micros()).unwrap_or(BINS - 1).min(BINS - 1);
        self.bins[bin] += 1;
    }

    /// Returns the computing time that this share of the cycles does not exceed, us; `None` without a cycle.
    #[must_use]
    pub fn computing_us(&self, share: f64) -> Option<usize> {
        let total: u64 = self.bins.iter().map(|n| u64::from(*n)).sum();
        let mut seen = 0;
        self.bins.iter().position(|n| {
            seen += u64::from(*n);
            total > 0 && seen as f64 >= share * total as f64
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_read_from_the_histogram() {
        let mut figures = LoopFigures::default();
        assert_eq!(figures.computing_us(0.5), None);
        for us in 0..100 {
            figures.add(Duration::from_micros(us), 1);
        }
        figures.add(Duration::from_millis(5), 3);
        assert_eq!(figures.computing_us(0.5), Some(50));
        assert_eq!(figures.computing_us(0.99), Some(99));
        assert_eq!((figures.cycles, figures.lost_states), (101, 2));
        assert_eq!(figures.longest, Duration::from_millis(5));
    }
}
