//! Comparison of trained policies over a few trainings: interquartile mean, probability of improvement and performance profile
//! with intervals by stratified bootstrap (Agarwal et al. 2021), an exact paired test, and a sequential one.
//!
//! Scores come as one row for each stratum, such as an object, with one value for each training. The figures without draws are
//! those of the Python package `rliable` to rounding, and the intervals are its percentile intervals up to the draws
//! (`tests/bench/rliable`).

mod sequential;

pub use sequential::{Decision, SequentialSigns};

use crate::seed;
use crate::statistics::{QuantileMethod, mean, quantile};
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// Share of the values that an interquartile mean leaves out at each end.
const TRIMMED: f64 = 0.25;

/// Estimate with a percentile interval of its bootstrap distribution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Estimate from the values as they are.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Draws of a bootstrap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// Number of resamples.
    pub resamples: usize,
    /// Share of the bootstrap distribution between the ends of an interval, 0 to 1.
    pub level: f64,
    /// Seed of the draws.
    pub seed: u64,
    /// True if the values of one place in all strata of a set belong to one training, such as its scores on several objects: they are
    /// then drawn together. False: strata are independent.
    pub together: bool,
}

impl Default for Bootstrap {
    fn default() -> Self {
        Self { resamples: 2_000, level: 0.95, seed: 1, together: false }
    }
}

impl Bootstrap {
    /// Interval of a statistic of several sets of scores. The values of each stratum of each set are drawn anew from those of
    /// the same stratum, with replacement.
    ///
    /// # Panics
    /// If the strata of a set have different numbers of values, and are drawn together.
    pub fn interval(&self, sets: &[&[Vec<f64>]], statistic: impl Fn(&[Vec<Vec<f64>>]) -> f64) -> Interval {
        let mut drawn: Vec<Vec<Vec<f64>>> = sets.iter().map(|set| set.to_vec()).collect();
        let value = statistic(&drawn);
        let mut values: Vec<f64> = (0..self.resamples)
            .map(|k| {
                let mut rng = seed::rng(self.seed, k as u64);
                for (to, from) in drawn.iter_mut().zip(sets) {
                    let count = if self.together { from.first().map_or(0, Vec::len) } else { 0 };
                    let places: Vec<usize> = (0..count).map(|_| rng.random_range(0..count)).collect();
                    for (to, from) in to.iter_mut().zip(*from) {
                        for (place, value) in to.iter_mut().enumerate() {
                            let at = if self.together { places[place] } else { rng.random_range(0..from.len()) };
                            *value = from[at];
                        }
                    }
                }
                statistic(&drawn)
            })
            .collect();
        values.sort_unstable_by(f64::total_cmp);
        let tail = 0.5 * (1.0 - self.level);
        let at = |q| quantile(&values, q, QuantileMethod::Linear);
        Interval { value, low: at(tail), high: at(1.0 - tail) }
    }

    /// Interquartile mean of all scores of all strata.
    pub fn interquartile_mean(&self, scores: &[Vec<f64>]) -> Interval {
        self.interval(&[scores], |sets| interquartile_mean(&sets[0]))
    }

    /// Difference of the interquartile means of two sets, the first minus the second, drawn apart.
    pub fn gain(&self, first: &[Vec<f64>], second: &[Vec<f64>]) -> Interval {
        self.interval(&[first, second], |sets| interquartile_mean(&sets[0]) - interquartile_mean(&sets[1]))
    }

    /// Probability that a score of the first set exceeds one of the second.
    pub fn probability_of_improvement(&self, first: &[Vec<f64>], second: &[Vec<f64>]) -> Interval {
        self.interval(&[first, second], |sets| probability_of_improvement(&sets[0], &sets[1]))
    }

    /// Share of the scores above each threshold.
    pub fn performance_profile(&self, scores: &[Vec<f64>], thresholds: &[f64]) -> Vec<Interval> {
        let above = |threshold: f64, set: &[Vec<f64>]| {
            let all = set.iter().flatten();
            all.clone().filter(|v| **v > threshold).count() as f64 / all.count() as f64
        };
        thresholds.iter().map(|&t| self.interval(&[scores], |sets| above(t, &sets[0]))).collect()
    }
}

/// Mean of the middle half of all values.
pub fn interquartile_mean(scores: &[Vec<f64>]) -> f64 {
    let mut all: Vec<f64> = scores.iter().flatten().copied().collect();
    all.sort_unstable_by(f64::total_cmp);
    let cut = (TRIMMED * all.len() as f64) as usize;
    mean(&all[cut..all.len() - cut])
}

/// Probability that a value of a stratum of `first` exceeds one of the same stratum of `second`, with a half for equal values, as
/// a mean over the strata: Mann and Whitney's U over the number of pairs.
pub fn probability_of_improvement(first: &[Vec<f64>], second: &[Vec<f64>]) -> f64 {
    let one = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let wins = |x: f64, y: f64| if x > y { 1.0 } else { 0.5 * f64::from(u8::from(x == y)) };
        let sum: f64 = a.iter().flat_map(|&x| b.iter().map(move |&y| wins(x, y))).sum();
        sum / (a.len() * b.len()) as f64
    };
    mean(&first.iter().zip(second).map(one).collect::<Vec<f64>>())
}

/// Two-sided p-value of the hypothesis that paired differences are as likely to have either sign: the share of all sign changes
/// whose mean is as far from zero (Fisher 1935). Exact up to [`MOST_EXACT`] differences, from random sign changes beyond.
pub fn sign_change_test(differences: &[f64], test_seed: u64) -> f64 {
    let n = differences.len();
    let observed = differences.iter().sum::<f64>().abs();
    // Sums in another order differ by rounding.
    let limit = observed - 1e-12 * differences.iter().map(|d| d.abs()).sum::<f64>();
    let of = |signs: u64| -> f64 {
        differences.iter().enumerate().map(|(i, d)| if signs >> i & 1 == 1 { -d } else { *d }).sum::<f64>().abs()
    };
    if n <= MOST_EXACT {
        let all = 1_u64 << n;
        return (0..all).filter(|&signs| of(signs) >= limit).count() as f64 / all as f64;
    }
    let mut rng = seed::rng(test_seed, 0);
    let mut drawn = || differences.iter().map(|d| if rng.random_bool(0.5) { -d } else { *d }).sum::<f64>().abs();
    let as_far = (0..SIGN_CHANGES).filter(|_| drawn() >= limit).count();
    // The observed signs count as one of the changes, so that the test keeps its level.
    (as_far + 1) as f64 / (SIGN_CHANGES + 1) as f64
}

/// Most differences whose sign changes are all tried.
pub const MOST_EXACT: usize = 16;
/// Random sign changes beyond that number of differences.
const SIGN_CHANGES: usize = 20_000;

#[cfg(test)]
mod tests {
    use super::*;

    fn scores() -> [Vec<Vec<f64>>; 2] {
        let first = vec![vec![0.9, 0.7, 0.8, 0.6, 0.95], vec![0.5, 0.4, 0.45, 0.55, 0.3]];
        let second = vec![vec![0.6, 0.65, 0.7, 0.5, 0.55], vec![0.5, 0.35, 0.2, 0.4, 0.25]];
        [first, second]
    }

    #[test]
    fn figures_agree_with_rliable() {
        // Set 0 of `tests/bench/rliable/run`, which prints the same for rliable 1.2.0.
        let [first, second] = scores();
        assert!((interquartile_mean(&first) - 0.6).abs() < 1e-12, "{}", interquartile_mean(&first));
        let improvement = probability_of_improvement(&first, &second);
        assert!((improvement - 0.82).abs() < 1e-12, "{improvement}");
        let profile = Bootstrap::default().performance_profile(&first, &[0.45, 0.75]);
        assert!((profile[0].value - 0.7).abs() < 1e-12 && (profile[1].value - 0.3).abs() < 1e-12, "{profile:?}");
    }

    #[test]
    fn intervals_hold_the_estimate_and_depend_on_the_seed_alone() {
        let [first, second] = scores();
        let bootstrap = Bootstrap::default();
        let gain = bootstrap.gain(&first, &second);
        assert!(gain.low < gain.value && gain.value < gain.high, "{gain:?}");
        assert_eq!(gain, bootstrap.gain(&first, &second));
        assert_ne!(gain, Bootstrap { seed: 2, ..bootstrap }.gain(&first, &second));
        // Equal strata that are drawn together are one stratum: the interval of their mean is as wide as that of one.
        let strata = vec![first[0].clone(); 4];
        let width = |together: bool, set: &[Vec<f64>]| {
            let i = Bootstrap { together, ..bootstrap }.interval(&[set], |s| mean(&s[0].concat()));
            i.high - i.low
        };
        assert!((width(true, &strata) / width(true, &strata[..1]) - 1.0).abs() < 0.1);
        assert!((2.0 * width(false, &strata) / width(true, &strata) - 1.0).abs() < 0.1);
        let same = vec![vec![0.5; 4]; 3];
        let none = bootstrap.gain(&same, &same);
        assert_eq!((none.low, none.value, none.high), (0.0, 0.0, 0.0));
    }

    #[test]
    fn an_interval_holds_the_true_mean_about_as_often_as_it_says() {
        // 400 sets of four strata with ten uniform values: 95 % intervals of the interquartile mean hold 0.5 in 90 to 98 % of them.
        let held = (0..400)
            .filter(|&k| {
                let mut rng = seed::rng(9, k);
                let set: Vec<Vec<f64>> =
                    (0..4).map(|_| (0..10).map(|_| rng.random_range(0.0..1.0)).collect()).collect();
                let found = Bootstrap { resamples: 300, ..Bootstrap::default() }.interquartile_mean(&set);
                found.low <= 0.5 && 0.5 <= found.high
            })
            .count();
        assert!((360..=392).contains(&held), "{held} of 400");
    }

    #[test]
    fn sign_changes_are_counted_and_drawn_to_the_same_p() {
        assert_eq!(sign_change_test(&[0.1; 10], 1), 2.0 / 1024.0);
        assert_eq!(sign_change_test(&[1.0, -1.0], 1), 1.0);
        // 17 differences are beyond the exact test; with one of them zero, its p-value is that of the other 16.
        let mut differences: Vec<f64> = (0..16).map(|i| f64::from(i) - 5.0).collect();
        let exact = sign_change_test(&differences, 1);
        differences.push(0.0);
        let drawn = sign_change_test(&differences, 1);
        assert!((drawn - exact).abs() < 4.0 * (exact / 20_000.0).sqrt(), "{drawn}, {exact}");
    }
}
