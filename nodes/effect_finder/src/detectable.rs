//! How large an effect must be to show.

use crate::calibrate::best_fit;
use crate::candidate::Candidate;
use crate::case::Case;
use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem, Start};
use crate::settings::Settings;
use catenary_core::Track;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Quantiles of the normal distribution: that at which a test of 5 % rejects, and that over which four of five draws lie.
const REJECTED_FROM: f64 = 1.645;
const IN_FOUR_OF_FIVE: f64 = 0.842;
/// Magnitudes that are looked at, from the first to the last evenly in the logarithm.
const MAGNITUDES: usize = 24;
/// The least of them, over the greatest that a search looks at.
const LEAST: f64 = 1e-4;
/// Next larger magnitudes, up to three times the first, at which it must show again.
const AGAIN: usize = 3;
/// Draws of the priors, and the best of them from which fits start, that look for the present model's best answer.
const DRAWS: usize = 200;
const STARTS: usize = 4;

/// Size at which the first-order limit starts, over the greatest of the prior, and its steps.
const FIRST: f64 = 0.3;
const STEPS: usize = 3;

/// Limit of detection of an effect in some recordings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Its name in a sentence.
    pub title: String,
    /// Least size that shows in four of five such data sets; none where the greatest that a search looks at does not, or the
    /// effect cannot act.
    pub size: Option<f64>,
}

/// Limits of detection of the candidates, to first order: the present model's answer to each effect is a step along its
/// derivatives at `fit`. [`detectable_size`] fits it anew instead, which takes a hundred times as long.
///
/// `on_round` may end it before each candidate.
///
/// # Errors
/// [`FinderError::NoFit`] where the present model cannot be simulated at the fit, [`FinderError::Cancelled`] where `on_round`
/// breaks.
pub fn limits(
    problem: &Problem<'_>,
    fit: &Fit,
    candidates: &[Candidate],
    on_round: OnRound<'_>,
) -> Result<Vec<Limit>, FinderError> {
    let own = problem.tracks(&[&fit.point])?.pop().ok_or_else(|| FinderError::NoFit("no track came".into()))?;
    let limit = |c: &Candidate| {
        if on_round().is_break() {
            return Err(FinderError::Cancelled("limits"));
        }
        let size = first_order_size(problem, fit, &own, c);
        Ok(Limit { name: c.name.clone(), title: c.title.clone(), size })
    };
    candidates.iter().map(limit).collect()
}

fn first_order_size(problem: &Problem<'_>, fit: &Fit, own: &[Track], candidate: &Candidate) -> Option<f64> {
    let channels = problem.channels().len();
    let needed = needed(channels.saturating_sub(fit.point.len()).max(1) as f64);
    let with = Problem { unknowns: problem.unknowns.with(candidate), ..*problem };
    let search = candidate.search();
    let most = search.bounds().1 - candidate.base;
    let left = |size: f64| -> Option<f64> {
        let mut point = with.unknowns.point_from(&problem.unknowns, &fit.point);
        point[with.unknowns.columns() - 1] = search.to_unit(candidate.base + size).clamp(0.0, 1.0);
        let tracks = with.tracks(&[&point]).ok()?.pop()?;
        // Rows of priors come after those of the data, and stay zero.
        let mut residuals = DVector::zeros(fit.residuals.len());
        let parts = problem.cases.iter().zip(&tracks).zip(own).map(|((case, m), own)| case.residuals(m, own));
        parts.flat_map(|r| r.data.as_vec().clone()).enumerate().for_each(|(i, r)| residuals[i] = r);
        Some(Fit { cost: residuals.norm_squared(), residuals, ..fit.clone() }.descended().cost)
    };
    let mut size = (FIRST * candidate.prior.bounds().1).min(most);
    for _ in 0..STEPS {
        let cost = left(size)?;
        if !(cost.is_finite() && cost > 0.0) || (size >= most && cost < needed) {
            return None;
        }
        // What is left grows with the square of a small effect.
        size = (size * (needed / cost).sqrt()).clamp(LEAST * most, most);
    }
    (size < most || left(most)? >= needed).then_some(size)
}

/// The magnitude of `candidate` from which, and up to three times which, the present model, whatever values its unknowns take, is
/// rejected at 5 % in four of five data sets as those of `problem`, in which the unknowns have the values of the point `u`: the
/// usual power of what is called detectable. None where the effect stays smaller than that up to the greatest magnitude that a
/// search looks at, or cannot act.
///
/// # Errors
/// [`FinderError::NoFit`] where the present model cannot be simulated at `u`.
pub fn detectable_size(problem: &Problem<'_>, u: &[f64], candidate: &Candidate) -> Result<Option<f64>, FinderError> {
    let tracks = problem.tracks(&[u])?.pop().ok_or_else(|| FinderError::NoFit("no track came".into()))?;
    // What the present model says at the point, with its derivatives; the residuals of its own tracks are none.
    let start = Start { point: u.to_vec(), tracks: tracks.clone() };
    let seen = problem.look(vec![start], &mut || ControlFlow::Continue(()))?;
    let Some(base) = seen.into_iter().flatten().next().map(|s| s.fit) else { return Ok(None) };
    let needed = needed(base.residuals.len().saturating_sub(u.len()).max(1) as f64);
    let worlds = worlds(problem, u, candidate);
    // If the simulator were linear, from here on the effect would show.
    let linear = |measured: &[Track]| {
        let parts = problem.cases.iter().zip(measured).zip(&tracks).map(|((case, m), own)| case.residuals(m, own));
        let mut residuals = base.residuals.clone();
        parts.flat_map(|r| r.data.as_vec().clone()).enumerate().for_each(|(i, r)| residuals[i] = r);
        Fit { cost: residuals.norm_squared(), residuals, ..base.clone() }.descended().cost
    };
    let Some(first) = worlds.iter().position(|(_, m)| m.as_ref().is_some_and(|m| linear(m) >= needed)) else {
        return Ok(None);
    };
    let mut before: Option<(f64, Fit)> = None;
    let mut shown: Vec<(f64, Fit)> = Vec::new();
    for (magnitude, measured) in worlds.into_iter().skip(first.saturating_sub(1)) {
        let Some(tracks) = measured else { break };
        let last = shown.last().or(before.as_ref()).map(|(_, fit)| fit.point.as_slice());
        // The first and the last that show are looked at everywhere, those between near what is known.
        let is_last = shown.len() == AGAIN;
        let known = [u].into_iter().chain(last).collect();
        let fit = answer(problem, &tracks, known, if shown.is_empty() || is_last { needed } else { f64::INFINITY })?;
        if fit.cost < needed {
            (before, shown) = (Some((magnitude, fit)), Vec::new());
        } else {
            shown.push((magnitude, fit));
            if is_last {
                break;
            }
        }
    }
    let Some((magnitude, fit)) = shown.into_iter().next() else { return Ok(None) };
    Ok(Some(match before {
        Some((smaller, less)) if less.cost > 0.0 => {
            smaller * (magnitude / smaller).powf((needed / less.cost).ln() / (fit.cost / less.cost).ln())
        }
        _ => magnitude,
    }))
}

/// What an effect has to add to the sum of squares of `n` coordinates beyond the fitted unknowns' number. With it, that is a
/// noncentral chi-square: the mean is n + x, the variance 2 n + 4 x. Without, the test rejects from n + 1.645 sqrt(2 n) on.
fn needed(n: f64) -> f64 {
    let rejected = REJECTED_FROM * (2.0 * n).sqrt();
    let square = IN_FOUR_OF_FIVE.powi(2);
    // The greater root of (x - rejected)^2 = square (2 n + 4 x).
    rejected + 2.0 * square + (4.0 * square * (rejected + square) + 2.0 * n * square).sqrt()
}

/// The present model's best answer to a data set that has the effect and no noise: near points that are known, or if that leaves
/// more than `enough`, anywhere. A little more of an effect may fold the object another way, and the answer be far off.
fn answer(problem: &Problem<'_>, tracks: &[Track], known: Vec<&[f64]>, enough: f64) -> Result<Fit, FinderError> {
    let with = |(case, track): (&Case, &Track)| case.with_measured(track.clone());
    let cases: Vec<Case> = problem.cases.iter().zip(tracks).map(with).collect();
    let own = Problem { cases: &cases, unknowns: problem.unknowns.clone(), ..*problem };
    let known: Vec<Vec<f64>> = known.into_iter().map(<[f64]>::to_vec).collect();
    let mut go_on = || ControlFlow::Continue(());
    let near = own.best_of(known.clone(), known.len(), &mut go_on)?;
    if near.cost < enough {
        return Ok(near);
    }
    let settings = Settings { draws: DRAWS, starts: STARTS, ..Settings::default() };
    let points = [near.point.clone()].into_iter().chain(known).collect();
    let far = best_fit(&own, points, &settings, &mut go_on)?;
    Ok(if far.cost < near.cost { far } else { near })
}

/// Magnitudes that a search looks at, in increasing order, with the tracks of episodes in which the effect has them; none
/// where it cannot have.
fn worlds(problem: &Problem<'_>, u: &[f64], candidate: &Candidate) -> Vec<(f64, Option<Vec<Track>>)> {
    let with = Problem { unknowns: problem.unknowns.with(candidate), ..*problem };
    let search = candidate.search();
    let most = search.bounds().1 - candidate.base;
    let magnitudes = (0..MAGNITUDES).map(|i| most * LEAST.powf(1.0 - i as f64 / (MAGNITUDES - 1) as f64));
    let point = |magnitude: &f64| {
        let mut point = with.unknowns.point_from(&problem.unknowns, u);
        point[with.unknowns.columns() - 1] = search.to_unit(candidate.base + magnitude).clamp(0.0, 1.0);
        point
    };
    let magnitudes: Vec<f64> = magnitudes.collect();
    let points: Vec<Vec<f64>> = magnitudes.iter().map(point).collect();
    let tracks = with.tracks_each(&points).into_iter().map(Result::ok);
    magnitudes.into_iter().zip(tracks).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy, folding};
    use catenary_core::{DifferentiableSimulator, Prior, seed};
    use rand_distr::{Distribution, StandardNormal};

    const TRUTH: [f64; 2] = [0.25, 2e4];

    /// The size of a tip mass, and the problem's answer to it.
    fn size(simulator: &dyn DifferentiableSimulator, gain: f64) -> Option<f64> {
        let cases = [toy::case(&Toy { gain }, TRUTH, &[])];
        let problem = Problem::of(&toy::model(), &cases, simulator, 40);
        let u = problem.unknowns.list().iter().zip(TRUTH).map(|(unknown, value)| unknown.prior.to_unit(value));
        let prior = Prior::LogUniform { low: 1e-3, high: 0.3 };
        let name = "tip_mass_kg".to_owned();
        let candidate = Candidate { title: name.clone(), name, prior, range: [0.0, 1.0], base: 0.0, odds: 1.0 };
        detectable_size(&problem, &u.collect::<Vec<_>>(), &candidate).unwrap()
    }

    /// What theta cannot explain of an effect of size m is proportional to m: at twice the gain half the size shows.
    #[test]
    fn the_size_of_a_linear_effect_is_that_whose_remainder_has_the_needed_square() {
        let toy = Toy { gain: 0.3 };
        let found = size(&toy, 0.3).unwrap();
        let cases = [toy::case(&toy, TRUTH, &[("tip_mass_kg", found)])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fits = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap();
        let needed = needed((8 * toy::FRAMES - 2) as f64);
        let left = fits[0].as_ref().unwrap().cost;
        assert!((left / needed - 1.0).abs() < 0.05, "{left} of {needed}");
        let half = size(&Toy { gain: 0.6 }, 0.6).unwrap();
        assert!((found / half - 2.0).abs() < 0.1, "{found} {half}");
    }

    #[test]
    fn limits_of_first_order_are_those_of_a_linear_effect() {
        let gain = 0.3;
        let toy = Toy { gain };
        let cases = [toy::case(&toy, TRUTH, &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        let prior = Prior::LogUniform { low: 1e-3, high: 0.3 };
        let named = |name: &str, high: f64| Candidate {
            title: name.to_owned(),
            name: name.to_owned(),
            prior: Prior::Uniform { low: 0.0, high },
            range: [0.0, high],
            base: 0.0,
            odds: 1.0,
        };
        let mass = Candidate { prior, range: [0.0, 1.0], ..named("tip_mass_kg", 1.0) };
        let candidates = [mass, named("tip_mass_kg", 1e-6)];
        let mut asked = 0;
        let mut once = || {
            asked += 1;
            if asked > 1 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let stopped = limits(&problem, &fit, &candidates, &mut once);
        assert!(matches!(stopped, Err(FinderError::Cancelled(_))), "{stopped:?}");
        let found = limits(&problem, &fit, &candidates, &mut || ControlFlow::Continue(())).unwrap();
        let (first_order, fitted) = (found[0].size.unwrap(), size(&toy, gain).unwrap());
        assert!((first_order / fitted - 1.0).abs() < 0.1, "{first_order} {fitted}");
        assert_eq!(found[1].size, None, "a range that ends before it shows");
    }

    #[test]
    fn what_is_needed_is_rejected_in_four_of_five_draws() {
        let (n, draws) = (100, 4000);
        let (mut rng, limit) = (seed::rng(1, 1), n as f64 + REJECTED_FROM * (2.0 * n as f64).sqrt());
        let each = (needed(n as f64) / n as f64).sqrt();
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut square = |by: f64| (0..n).map(|_| (by + normal()).powi(2)).sum::<f64>();
        let share = |by: f64, square: &mut dyn FnMut(f64) -> f64| {
            (0..draws).filter(|_| square(by) > limit).count() as f64 / draws as f64
        };
        // Standard errors are 0.0034 and 0.0063; the chi-square is a little skew.
        let (alarm, power) = (share(0.0, &mut square), share(each, &mut square));
        assert!((0.04..0.07).contains(&alarm) && (0.77..0.83).contains(&power), "{alarm} {power}");
    }

    /// The object folds another way for a hair's breadth of the effect, and for as much less length: that explains it.
    #[test]
    fn what_another_fold_of_the_present_model_explains_does_not_show() {
        let gain = 0.3;
        let (linear, folding) = (size(&Toy { gain }, gain), size(&folding(Toy { gain }, 0.2498), gain));
        let (linear, folding) = (linear.unwrap(), folding.unwrap());
        assert!(linear > 1e-3 && (folding / linear - 1.0).abs() < 0.2, "{folding}, and without folds {linear}");
    }
}
