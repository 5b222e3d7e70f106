//! Difference of two clocks, by the delays of messages that were logged together.

use super::times::{Times, since_s};
use catenary_core::statistics::{QuantileMethod, quantile};
use std::collections::VecDeque;

/// Greatest delay in s of a stream from stamp to log beyond that of the poses: exposure, transport and a slow tracker.
const LATE_S: f64 = 0.5;
/// Greatest time in s by which a stream's delay may be shorter than that of the poses: no message arrives before it was
/// measured.
const EARLY_S: f64 = 0.1;
/// Greatest time in s between the log times of two messages that are compared. Farther apart, a faster pace of the
/// stamps would count as a difference.
const TOGETHER_S: f64 = 0.1;
/// Share of the messages that may be closer than the difference of two clocks: a stall of the recorder delays some.
const OUTLIERS: f64 = 0.1;
/// Number of differences that are kept: enough for quantiles of a tenth to be known to a percent.
const SAMPLE: usize = 8192;
/// Greatest number of messages that wait for the next one of the reference.
const WAITING: usize = 1024;

/// Evenly spaced part of a sequence of numbers of any length.
#[derive(Debug)]
struct Sample {
    values: Vec<f64>,
    /// Every so many numbers, one is kept.
    stride: usize,
    seen: usize,
}

impl Default for Sample {
    fn default() -> Self {
        Self { values: Vec::new(), stride: 1, seen: 0 }
    }
}

impl Sample {
    fn push(&mut self, value: f64) {
        if self.seen.is_multiple_of(self.stride) {
            if self.values.len() == SAMPLE {
                let mut place = 0;
                self.values.retain(|_| (place += 1, place % 2 == 1).1);
                self.stride *= 2;
            }
            if self.seen.is_multiple_of(self.stride) {
                self.values.push(value);
            }
        }
        self.seen += 1;
    }
}

/// Differences in s between the delays, from stamp to log, of a topic and of the reference.
///
/// Only messages that were logged at about the same time are compared, because a bag may have been recorded from a replay at
/// another rate.
#[derive(Debug, Default)]
pub(super) struct Offsets {
    sample: Sample,
    /// Messages since the newest one of the reference.
    waiting: VecDeque<Times>,
}

impl Offsets {
    /// Adds a message; `known` is the newest one of the reference.
    pub(super) fn push(&mut self, times: Times, known: Option<Times>) {
        self.waiting.push_back(times);
        if self.waiting.len() > WAITING {
            self.settle(known, None);
        }
    }

    /// Compares the waiting messages with the nearer of the messages of the reference before and after them.
    pub(super) fn settle(&mut self, before: Option<Times>, after: Option<Times>) {
        for times in self.waiting.drain(..) {
            let near = [before, after].into_iter().flatten().min_by_key(|known| known.log_ns.abs_diff(times.log_ns));
            let together = near.filter(|known| since_s(known.log_ns, times.log_ns).abs() <= TOGETHER_S);
            if let Some(known) = together {
                self.sample.push(times.delay_s() - known.delay_s());
            }
        }
    }

    /// Difference in s: the smallest one apart from a few outliers.
    fn offset_s(&self) -> Option<f64> {
        let mut offsets = self.sample.values.clone();
        offsets.sort_by(f64::total_cmp);
        if offsets.is_empty() {
            return None;
        }
        let [low, high] = [OUTLIERS, 1.0 - OUTLIERS].map(|q| quantile(&offsets, q, QuantileMethod::Nearest));
        // The difference nearest to zero: if most are positive it is the low end, if most are negative the high end.
        Some(if low > 0.0 { low } else { high.min(0.0) })
    }

    /// Sentence about the clock of `topic`, if it differs from that of `reference`.
    pub(super) fn note(&self, topic: &str, reference: &str) -> Option<String> {
        let offset_s = self.offset_s()?;
        let what = if offset_s > LATE_S {
            format!("stamps {offset_s:.3} s behind")
        } else if offset_s < -EARLY_S {
            format!("stamps {:.3} s ahead of", -offset_s)
        } else {
            return None;
        };
        Some(format!(
            "{topic}: header.stamp: expected the clock of {reference}, got {what} its, for messages that were logged together: two clocks that differ, such as a camera's own clock, or a slow node; stamp both with the host's clock and record again"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_stays_small_and_even() {
        let mut sample = Sample::default();
        (0..100_000).for_each(|i| sample.push(f64::from(i)));
        assert!((SAMPLE / 2..=SAMPLE).contains(&sample.values.len()), "{}", sample.values.len());
        assert!(sample.values.windows(2).all(|w| w[1] - w[0] == sample.stride as f64));
        assert_eq!(sample.stride, 16);
    }
}
