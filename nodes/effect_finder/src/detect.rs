//! Is what is left after the fit more than noise?
//!
//! The statistic is the whitened residual energy of the best fit. Its null distribution comes from data sets that are
//! simulated from the fitted model's posterior and fitted again, each: the measured data were used for a fit, too.

use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem, Simulated};
use crate::laplace::Laplace;
use crate::settings::Settings;
use catenary_core::seed;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// Random stream of the null sets' parameters and noise, beyond those of fits.
const STREAM: u64 = 1000;
/// Null sets that are fitted in step: their derivatives are in memory at once.
const SLICE: usize = 25;
/// How many null sets are drawn at most for each that is wanted, as some can neither be simulated nor fitted.
const DRAWS: usize = 3;

/// What the fit of a null set left.
#[derive(Debug, Clone)]
pub struct Residue {
    /// Sum of the squared residuals, T.
    pub cost: f64,
    /// Residuals in standard deviations of the noise, a row a channel.
    pub residuals: DVector<f64>,
}

/// The outcome of the test, with what it rests on.
#[derive(Debug, Clone)]
pub struct Detection {
    /// p = (1 + number of null sets whose T is at least the measured one) / (1 + B); of a test that ended sooner their number
    /// over that of all until then.
    pub p_value: f64,
    /// T of the measured data.
    pub statistic: f64,
    /// What is left of the null sets (B).
    pub null: Vec<Residue>,
    /// How many more were drawn, and could not be simulated or fitted.
    pub null_left_out: usize,
}

/// A detection as files hold it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Test {
    /// p-value of the hypothesis that the model explains the data.
    pub p_value: f64,
    /// Sum of the squared residuals of the best fit, in variances of the noise.
    pub statistic: f64,
    /// The same of each data set that was simulated from the fitted model and fitted again, in increasing order.
    pub null: Vec<f64>,
    /// How many more such data sets were drawn, and could not be simulated or fitted.
    pub null_left_out: usize,
    /// Number of measured coordinates.
    pub coordinates: usize,
}

impl Detection {
    /// The detection as files hold it.
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
    (1.0 + as_large) / (1.0 + count)
}

/// Tests whether the model of `problem`, at `fit`, explains the data. Where p is far from small, `enough` null sets whose T is at
/// least the measured one end the test; p is then their share of all, and as uniform as ever (Besag and Clifford 1991).
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
    let mut null: Vec<Residue> = Vec::new();
    let mut refusal = "they could be simulated, but not fitted".to_owned();
    let (mut number, most) = (0, DRAWS * settings.null_sets);
    while null.len() < settings.null_sets && number < most {
        let next = most.min(number + SLICE.min(settings.null_sets - null.len()));
        let points = (number..next).map(|b| posterior.draw(&mut seed::rng(seeds, 2 * b as u64))).collect();
        let sets = simulate(problem, points, seeds, number, &mut refusal);
        if on_round().is_break() {
            return Err(FinderError::Cancelled("fit"));
        }
        let residue = |fit: Fit| Residue { cost: fit.cost, residuals: fit.residuals };
        match problem.refit(fit, sets, on_round) {
            Ok(fits) => null.extend(fits.into_iter().flatten().map(residue)),
            Err(FinderError::NoFit(reason)) => refusal = reason,
            Err(other) => return Err(other),
        }
        number = next;
        let null_left_out = number - null.len();
        if let Some(last) = enough.and_then(|enough| place_of(enough, fit.cost, &null)) {
            null.truncate(last + 1);
            let p_value = enough.unwrap_or_default() as f64 / null.len() as f64;
            return Ok(Detection { p_value, statistic: fit.cost, null, null_left_out });
        }
    }
    if null.len() < settings.null_sets {
        return Err(FinderError::NullSets { expected: settings.null_sets, got: null.len(), drawn: number, refusal });
    }
    let p_value = p_value(fit.cost, null.iter().map(|f| f.cost));
    let null_left_out = number - null.len();
    Ok(Detection { p_value, statistic: fit.cost, null, null_left_out })
}

/// The place of the null set with which `count` have a T of at least `statistic`.
fn place_of(count: usize, statistic: f64, null: &[Residue]) -> Option<usize> {
    let as_large = null.iter().enumerate().filter(|(_, set)| set.cost >= statistic);
    as_large.map(|(place, _)| place).nth(count.checked_sub(1)?)
}

/// Data sets measured at the points; those that cannot be simulated are left out.
fn simulate(
    problem: &Problem<'_>,
    points: Vec<Vec<f64>>,
    seeds: u64,
    first: usize,
    refusal: &mut String,
) -> Vec<Simulated> {
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
        let measured = problem.cases.iter().zip(&tracks).map(|(case, track)| case.measure(track, &mut noise)).collect();
        sets.push(Simulated { point, tracks, measured });
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Start;
    use crate::toy::{self, Toy};
    use std::ops::ControlFlow;

    /// p-values of worlds of the toy in which an effect has the value `effect`.
    fn p_values(effect: f64, worlds: u64, enough: Option<usize>) -> Vec<f64> {
        let toy = Toy { gain: 0.3 };
        let world = |i: u64| {
            let case = toy::case(&toy, [0.25, 2e4], &[("tip_mass_kg", effect)]);
            let cases = [case.measured_anew(&mut seed::rng(21, i))];
            let problem = Problem::of(&toy::model(), &cases, &toy, 40);
            let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
            let mut go_on = || ControlFlow::Continue(());
            let fit = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
            let settings = Settings { null_sets: 39, seed: i, ..Settings::default() };
            detect(&problem, &fit, &settings, 0, enough, &mut go_on).unwrap().p_value
        };
        (0..worlds).map(world).collect()
    }

    /// Kolmogorov and Smirnov's distance of 100 uniform values is over 0.163 in one of 100 cases.
    #[test]
    fn without_a_gap_p_is_uniform() {
        for enough in [None, Some(5)] {
            let mut p = p_values(0.0, 100, enough);
            p.sort_by(f64::total_cmp);
            let distance = p.iter().enumerate().map(|(i, p)| (p - (i as f64 + 0.5) / 100.0).abs()).fold(0.0, f64::max);
            assert!(distance < 0.163, "{enough:?}: {distance}");
        }
    }

    /// Tests a fit of the toy, whose point `put` changes, against 39 null sets. The toy has no lengths under 0.2 m: half of what is
    /// drawn about the fit is none.
    fn detected(put: impl Fn(&mut Fit), on_round: OnRound<'_>) -> Result<Detection, FinderError> {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.2003, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let mut fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        put(&mut fit);
        detect(&problem, &fit, &Settings { null_sets: 39, ..Settings::default() }, 0, None, on_round)
    }

    #[test]
    fn what_cannot_be_simulated_is_drawn_anew_until_there_are_enough() {
        let Detection { mut null, null_left_out, .. } = detected(|_| (), &mut || ControlFlow::Continue(())).unwrap();
        assert!((20..=78).contains(&null_left_out), "{null_left_out} beside {}", null.len());
        null.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        assert!(null.windows(2).all(|two| two[0].cost < two[1].cost), "each is drawn once");
    }

    #[test]
    fn where_none_can_be_simulated_drawing_ends() {
        // Lengths that are known well, and begin at 0.195 m.
        let short = |fit: &mut Fit| {
            fit.point[0] = 0.0;
            fit.jacobian *= 100.0;
        };
        let refused = detected(short, &mut || ControlFlow::Continue(())).unwrap_err().to_string();
        let expected = "expected 39 data sets without a gap to test against, got 0 of 117: simulator: length_m: expected at least 0.2";
        assert!(refused.starts_with(expected), "{refused}");
        let cancelled = detected(short, &mut || ControlFlow::Break(()));
        assert!(matches!(cancelled, Err(FinderError::Cancelled(_))));
    }

    #[test]
    fn a_test_ends_with_the_last_null_set_that_it_needs() {
        let null: Vec<Residue> =
            [1.0, 5.0, 2.0, 3.0, 6.0].map(|cost| Residue { cost, residuals: DVector::zeros(1) }).into();
        assert_eq!(place_of(2, 3.0, &null), Some(3));
        assert_eq!((place_of(4, 3.0, &null), place_of(0, 3.0, &null)), (None, None));
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
