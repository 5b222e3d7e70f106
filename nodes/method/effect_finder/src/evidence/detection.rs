//! Test of whether the residual of a fit exceeds noise.
//!
//! The statistic T is the residual energy: the sum of squared whitened residuals of the best fit. Its null distribution
//! comes from null data sets, simulated from the Laplace posterior of the fit. Each null set is fitted again, because
//! the measured data were fitted, too.

use crate::error::FinderError;
use crate::settings::Settings;
use catenary_core::seed;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use track_fit::FitError;
use track_fit::fitting::{Fit, Laplace, OnRound, Problem, SimulatedSet};

/// Random stream of the null sets' parameters and noise, beyond the streams of fits.
const STREAM: u64 = 1000;
/// Null sets that are fitted in step. Their Jacobians are in memory at once.
const SLICE: usize = 25;
/// Most draws for each wanted null set; some can be neither simulated nor fitted.
const DRAWS: usize = 3;

/// Fit of a null data set.
#[derive(Debug, Clone)]
pub struct NullFit {
    /// Residual energy T.
    pub cost: f64,
    /// Residuals in standard deviations of the noise, a row a channel.
    pub residuals: DVector<f64>,
}

/// Result of the test.
#[derive(Debug, Clone)]
pub struct Detection {
    /// p-value: (1 + number of null sets with at least the measured T) / (1 + B). For a test that stopped early: that
    /// number over the number of null sets until then.
    pub p_value: f64,
    /// Residual energy T of the measured data.
    pub statistic: f64,
    /// Fits of the null sets (B).
    pub null: Vec<NullFit>,
    /// Number of further null sets that could not be simulated or fitted.
    pub null_left_out: usize,
}

/// Test result as files hold it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Test {
    /// p-value of the hypothesis that the model explains the data.
    pub p_value: f64,
    /// Residual energy of the best fit, in variances of the noise.
    pub statistic: f64,
    /// Residual energies of the null sets, in increasing order.
    pub null: Vec<f64>,
    /// Number of further null sets that could not be simulated or fitted.
    pub null_left_out: usize,
    /// Number of measured coordinates.
    pub coordinates: usize,
}

impl Detection {
    /// Test result as files hold it.
    pub fn summary(&self) -> Test {
        let mut null: Vec<f64> = self.null.iter().map(|f| f.cost).collect();
        null.sort_by(f64::total_cmp);
        let coordinates = self.null.first().map_or(0, |f| f.residuals.len());
        let null_left_out = self.null_left_out;
        Test { p_value: self.p_value, statistic: self.statistic, null, null_left_out, coordinates }
    }
}

/// p-value of `value` among values of the null hypothesis.
pub fn p_value(value: f64, null: impl Iterator<Item = f64>) -> f64 {
    let (mut count, mut as_large) = (0.0, 0.0);
    for other in null {
        count += 1.0;
        as_large += f64::from(u8::from(other >= value));
    }
    // The measured value counts as one more of the null distribution, so that no p-value is zero.
    (1.0 + as_large) / (1.0 + count)
}

/// Tests whether the model of `problem`, at `fit`, explains the data. The test stops early once `enough` null sets have
/// at least the measured T; the p-value of such a sequential test is uniform, too (Besag and Clifford 1991).
///
/// # Errors
/// [`FinderError`] of the simulator, or of a cancelled search.
pub fn detect(
    problem: &Problem<'_>,
    fit: &Fit,
    settings: &Settings,
    stream: u64,
    enough: Option<usize>,
    on_round: OnRound<'_>,
) -> Result<Detection, FinderError> {
    let posterior = Laplace::of(fit).ok_or_else(FinderError::curvature)?;
    let seeds = seed::derive(settings.seed, STREAM + stream);
    let mut null: Vec<NullFit> = Vec::new();
    let mut refusal = "they could be simulated, but not fitted".to_owned();
    let (mut number, most) = (0, DRAWS * settings.null_sets);
    while null.len() < settings.null_sets && number < most {
        let next = most.min(number + SLICE.min(settings.null_sets - null.len()));
        // Even streams draw parameters and odd ones noise, so that a set does not depend on how many others failed.
        let points = (number..next).map(|b| posterior.draw(&mut seed::rng(seeds, 2 * b as u64))).collect();
        let sets = simulate(problem, points, seeds, number, &mut refusal);
        if on_round().is_break() {
            return Err(FinderError::Cancelled("fit"));
        }
        let residue = |fit: Fit| NullFit { cost: fit.cost, residuals: fit.residuals };
        // Null sets lie near the fit, so that its derivatives serve them.
        match problem.refit(fit, sets, on_round) {
            Ok(fits) => null.extend(fits.into_iter().flatten().map(residue)),
            Err(FitError::NoFit(reason)) => refusal = reason,
            Err(other) => return Err(other.into()),
        }
        number = next;
        let null_left_out = number - null.len();
        if let Some(last) = enough.and_then(|enough| stopping_index(enough, fit.cost, &null)) {
            null.truncate(last + 1);
            // The share up to the last exceedance: Besag and Clifford's sequential p-value.
            let p_value = enough.unwrap_or_default() as f64 / null.len() as f64;
            return Ok(Detection { p_value, statistic: fit.cost, null, null_left_out });
        }
    }
    // With fewer sets than asked for, the smallest p-value would exceed the test's level.
    if null.len() < settings.null_sets {
        return Err(FinderError::NullSets { expected: settings.null_sets, got: null.len(), drawn: number, refusal });
    }
    let p_value = p_value(fit.cost, null.iter().map(|f| f.cost));
    let null_left_out = number - null.len();
    Ok(Detection { p_value, statistic: fit.cost, null, null_left_out })
}

/// Index of the null set with which `count` of them have a T of at least `statistic`.
fn stopping_index(count: usize, statistic: f64, null: &[NullFit]) -> Option<usize> {
    let as_large = null.iter().enumerate().filter(|(_, set)| set.cost >= statistic);
    as_large.map(|(place, _)| place).nth(count.checked_sub(1)?)
}

/// Data sets simulated at the points, with noise. Points that cannot be simulated are left out.
fn simulate(
    problem: &Problem<'_>,
    points: Vec<Vec<f64>>,
    seeds: u64,
    first: usize,
    refusal: &mut String,
) -> Vec<SimulatedSet> {
    let mut sets = Vec::with_capacity(points.len());
    for (b, (tracks, point)) in problem.tracks_each(&points).into_iter().zip(points).enumerate() {
        let tracks = match tracks {
            Ok(tracks) => tracks,
            Err(error) => {
                *refusal = error.to_string();
                continue;
            }
        };
        let mut noise = seed::rng(seeds, 2 * (first + b) as u64 + 1);
        let measured =
            problem.episodes.iter().zip(&tracks).map(|(episode, track)| episode.measure(track, &mut noise)).collect();
        sets.push(SimulatedSet { point, tracks, measured });
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::ControlFlow;
    use track_fit::fitting::Start;
    use track_fit::toy::{self, Toy};

    /// p-values of toy episodes with an effect of size `effect`.
    fn p_values(effect: f64, count: u64, enough: Option<usize>) -> Vec<f64> {
        let toy = Toy { gain: 0.3 };
        let p_value_of = |i: u64| {
            let episode = toy::episode(&toy, [0.25, 2e4], &[("tip_mass_kg", effect)]);
            let episodes = [episode.measured_anew(&mut seed::rng(21, i))];
            let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
            let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
            let mut go_on = || ControlFlow::Continue(());
            let fit = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
            let settings = Settings { null_sets: 39, seed: i, ..Settings::default() };
            detect(&problem, &fit, &settings, 0, enough, &mut go_on).unwrap().p_value
        };
        (0..count).map(p_value_of).collect()
    }

    /// The Kolmogorov-Smirnov distance of 100 uniform values exceeds 0.163 in one of 100 cases.
    #[test]
    fn p_values_are_uniform_without_a_gap() {
        for enough in [None, Some(5)] {
            let mut p = p_values(0.0, 100, enough);
            p.sort_by(f64::total_cmp);
            let distance = p.iter().enumerate().map(|(i, p)| (p - (i as f64 + 0.5) / 100.0).abs()).fold(0.0, f64::max);
            assert!(distance < 0.163, "{enough:?}: {distance}");
        }
    }

    /// Test of a toy fit, changed by `put`, against 39 null sets. The toy refuses lengths under 0.2 m, so that half of
    /// the draws about this fit fail.
    fn detected(put: impl Fn(&mut Fit), on_round: OnRound<'_>) -> Result<Detection, FinderError> {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.2003, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let mut fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        put(&mut fit);
        detect(&problem, &fit, &Settings { null_sets: 39, ..Settings::default() }, 0, None, on_round)
    }

    #[test]
    fn failed_null_sets_are_replaced_by_new_draws() {
        let Detection { mut null, null_left_out, .. } = detected(|_| (), &mut || ControlFlow::Continue(())).unwrap();
        assert!((20..=78).contains(&null_left_out), "{null_left_out} beside {}", null.len());
        null.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        assert!(null.windows(2).all(|two| two[0].cost < two[1].cost), "each is drawn once");
    }

    #[test]
    fn a_test_fails_if_no_null_set_can_be_simulated() {
        // The length is known well, and lies at 0.195 m, below the toy's least length.
        let short = |fit: &mut Fit| {
            fit.point[0] = 0.0;
            fit.jacobian *= 100.0;
        };
        let refused = detected(short, &mut || ControlFlow::Continue(())).unwrap_err().to_string();
        let expected = "expected 39 null data sets, got 0 of 117 draws: simulator: length_m: expected at least 0.2";
        assert!(refused.starts_with(expected), "{refused}");
        let cancelled = detected(short, &mut || ControlFlow::Break(()));
        assert!(matches!(cancelled, Err(FinderError::Cancelled(_))));
    }

    #[test]
    fn a_sequential_test_stops_at_the_last_null_set_that_it_needs() {
        let null: Vec<NullFit> =
            [1.0, 5.0, 2.0, 3.0, 6.0].map(|cost| NullFit { cost, residuals: DVector::zeros(1) }).into();
        assert_eq!(stopping_index(2, 3.0, &null), Some(3));
        assert_eq!((stopping_index(4, 3.0, &null), stopping_index(0, 3.0, &null)), (None, None));
    }

    #[test]
    fn a_large_effect_is_detected() {
        assert!(p_values(0.05, 5, Some(5)).iter().all(|p| *p == 1.0 / 40.0));
    }

    #[test]
    fn a_p_value_counts_those_at_least_as_large() {
        assert_eq!(p_value(3.0, [1.0, 2.0, 3.0, 4.0].into_iter()), 3.0 / 5.0);
        assert_eq!(p_value(9.0, [1.0, 2.0, 3.0, 4.0].into_iter()), 1.0 / 5.0);
    }
}
