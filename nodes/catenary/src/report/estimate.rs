//! Means and shares over episodes, with their intervals.

use catenary_core::statistics::{self, Z_95, wilson_interval};
use serde::{Deserialize, Serialize};

/// Mean or share with its 95 % interval.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Estimate {
    /// Mean of at least two values, with its interval by the normal approximation.
    pub fn mean(values: &[f64]) -> Self {
        let value = statistics::mean(values);
        let half = Z_95 * (statistics::variance(values) / values.len() as f64).sqrt();
        Self { value, low: value - half, high: value + half }
    }

    /// Share with its interval by Wilson (1927).
    pub fn share(hits: usize, of: usize) -> Self {
        let [low, high] = wilson_interval(hits, of);
        Self { value: hits as f64 / of as f64, low, high }
    }

    /// Difference of two shares over the same episodes, with the interval of Agresti and Min (2005). Half a pair is
    /// added to each cell of the table, so that the interval keeps a width even if all pairs agree.
    pub fn paired(own: &[bool], other: &[bool]) -> Self {
        let n = own.len() as f64;
        let only = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| **a && !**b).count() as f64;
        let (gained, lost) = (only(own, other), only(other, own));
        let (g, l, m) = (gained + 0.5, lost + 0.5, n + 2.0);
        let middle = (g - l) / m;
        let half = Z_95 * ((g + l) - (g - l).powi(2) / m).max(0.0).sqrt() / m;
        Self { value: (gained - lost) / n, low: (middle - half).max(-1.0), high: (middle + half).min(1.0) }
    }

    /// Estimate and interval in words, multiplied by `scale`.
    pub fn words(&self, scale: f64, digits: usize) -> String {
        let Self { value, low, high } = self;
        format!("{:.digits$} ({:.digits$} to {:.digits$})", scale * value, scale * low, scale * high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_agree_with_published_values() {
        let e = Estimate::mean(&[1.0, 2.0, 3.0, 4.0]);
        assert!(
            (e.value - 2.5).abs() < 1e-12 && (e.high - e.low - 2.0 * Z_95 * (5.0f64 / 12.0).sqrt()).abs() < 1e-9,
            "{e:?}"
        );
        // Wilson's interval for 5 of 100 is 2.15 to 11.18 %, for 0 of 10 it is 0 to 27.8 %.
        let share = Estimate::share(5, 100);
        assert!((share.low - 0.0215).abs() < 5e-4 && (share.high - 0.1118).abs() < 5e-4, "{share:?}");
        let none = Estimate::share(0, 10);
        assert!(none.low == 0.0 && (none.high - 0.278).abs() < 1e-3, "{none:?}");
    }

    #[test]
    fn the_paired_difference_counts_episodes_that_only_one_policy_solves() {
        let pairs = |both: usize, own: usize, other: usize, none: usize| {
            let column =
                |a: bool, b: bool| [vec![true; both], vec![a; own], vec![b; other], vec![false; none]].concat();
            Estimate::paired(&column(true, false), &column(false, true))
        };
        // 30 gained and 10 lost of 100: (20 +- 1.96 sqrt(41 - 400 / 102)) / 102.
        let e = pairs(40, 30, 10, 20);
        assert!(
            (e.value - 0.2).abs() < 1e-12 && (e.low - 0.0790).abs() < 5e-4 && (e.high - 0.3131).abs() < 5e-4,
            "{e:?}"
        );
        let same = pairs(50, 0, 0, 50);
        assert!(same.value == 0.0 && same.low < 0.0 && same.high > 0.0, "{same:?}");
    }
}
