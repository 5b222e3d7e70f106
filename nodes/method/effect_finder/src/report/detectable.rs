//! Detectable sizes: how large an effect must be for the test to reject the present model in four of five data sets.

use crate::error::FinderError;
use crate::settings::Settings;
use catenary_core::Track;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use track_fit::data::{Candidate, MeasuredEpisode};
use track_fit::fitting::{Fit, OnRound, Problem, Start, best_fit};

/// Quantiles of the normal distribution: a test of 5 % rejects above the first, 80 % of draws lie above minus the
/// second.
const REJECTED_FROM: f64 = 1.645;
const IN_FOUR_OF_FIVE: f64 = 0.842;
/// Number of tried magnitudes, evenly spaced in the logarithm.
const MAGNITUDES: usize = 24;
/// Smallest tried magnitude, relative to the largest of the search range.
const LEAST: f64 = 1e-4;
/// Number of next larger magnitudes (up to three times the first) at which the effect must be detected, too.
const AGAIN: usize = 3;
/// Draws of the priors, and starts, of the fits of the present model. Fewer than in a search, because a fit is made for
/// many magnitudes.
const DRAWS: usize = 200;
const STARTS: usize = 4;

/// Initial size of the first-order iteration, relative to the largest of the prior, and number of its steps.
const FIRST: f64 = 0.3;
const STEPS: usize = 3;

/// DetectionLimit of detection of an effect in some recordings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectionLimit {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Name in sentences.
    pub title: String,
    /// Smallest size detected in four of five such data sets. None if the largest size of the search range is not
    /// detected, or if the effect cannot act.
    pub size: Option<f64>,
}

/// Limits of detection of the candidates, to first order: the present model responds to each effect by one linear step
/// from `fit`. [`detectable_size`] fits the response instead, at a hundred times the cost.
///
/// `on_round` may end it before each candidate.
///
/// # Errors
/// [`FinderError::NoFit`] if the present model cannot be simulated at the fit, [`FinderError::Cancelled`] if `on_round`
/// breaks.
pub fn limits(
    problem: &Problem<'_>,
    fit: &Fit,
    candidates: &[Candidate],
    on_round: OnRound<'_>,
) -> Result<Vec<DetectionLimit>, FinderError> {
    let own = problem.tracks(&[&fit.point])?.pop().ok_or_else(|| FinderError::NoFit("no track came".into()))?;
    let limit = |c: &Candidate| {
        if on_round().is_break() {
            return Err(FinderError::Cancelled("limits"));
        }
        let size = first_order_size(problem, fit, &own, c);
        Ok(DetectionLimit { name: c.name.clone(), title: c.title.clone(), size })
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
        // The rows of the priors follow those of the data, and stay zero.
        let mut residuals = DVector::zeros(fit.residuals.len());
        let parts = problem.episodes.iter().zip(&tracks).zip(own).map(|((episode, m), own)| episode.residuals(m, own));
        parts.flat_map(|r| r.data.as_vec().clone()).enumerate().for_each(|(i, r)| residuals[i] = r);
        Some(Fit { cost: residuals.norm_squared(), residuals, ..fit.clone() }.linear_minimum().cost)
    };
    let mut size = (FIRST * candidate.prior.bounds().1).min(most);
    for _ in 0..STEPS {
        let cost = left(size)?;
        if !(cost.is_finite() && cost > 0.0) || (size >= most && cost < needed) {
            return None;
        }
        // The residual energy grows with the square of a small effect.
        size = (size * (needed / cost).sqrt()).clamp(LEAST * most, most);
    }
    (size < most || left(most)? >= needed).then_some(size)
}

/// Detectable size of `candidate`: the magnitude from which on (up to three times it) the present model, fitted anew,
/// is rejected at 5 % in four of five data sets like those of `problem`, with the unknowns at the point `u`. A power of
/// 80 % is the usual convention for a detectable size. None if no magnitude of the search range is detected, or if the
/// effect cannot act.
///
/// # Errors
/// [`FinderError::NoFit`] if the present model cannot be simulated at `u`.
pub fn detectable_size(problem: &Problem<'_>, u: &[f64], candidate: &Candidate) -> Result<Option<f64>, FinderError> {
    let tracks = problem.tracks(&[u])?.pop().ok_or_else(|| FinderError::NoFit("no track came".into()))?;
    // Linearisation of the present model at the point. Its residuals against its own tracks are zero.
    let start = Start { point: u.to_vec(), tracks: tracks.clone() };
    let seen = problem.linearise(vec![start], &mut || ControlFlow::Continue(()))?;
    let Some(base) = seen.into_iter().flatten().next().map(|s| s.fit) else { return Ok(None) };
    let needed = needed(base.residuals.len().saturating_sub(u.len()).max(1) as f64);
    let sizes = tracks_by_magnitude(problem, u, candidate);
    // Residual energy after a linear response. Magnitudes below the first one that a linear model shows need no fit.
    let linear = |measured: &[Track]| {
        let parts =
            problem.episodes.iter().zip(measured).zip(&tracks).map(|((episode, m), own)| episode.residuals(m, own));
        let mut residuals = base.residuals.clone();
        parts.flat_map(|r| r.data.as_vec().clone()).enumerate().for_each(|(i, r)| residuals[i] = r);
        Fit { cost: residuals.norm_squared(), residuals, ..base.clone() }.linear_minimum().cost
    };
    let Some(first) = sizes.iter().position(|(_, m)| m.as_ref().is_some_and(|m| linear(m) >= needed)) else {
        return Ok(None);
    };
    let mut before: Option<(f64, Fit)> = None;
    let mut shown: Vec<(f64, Fit)> = Vec::new();
    for (magnitude, measured) in sizes.into_iter().skip(first.saturating_sub(1)) {
        let Some(tracks) = measured else { break };
        let last = shown.last().or(before.as_ref()).map(|(_, fit)| fit.point.as_slice());
        // Only the first and the last detected magnitudes are fitted from everywhere; those between start near known
        // fits.
        let is_last = shown.len() == AGAIN;
        // Starts: the true point, and the last fit, which has followed the smaller magnitudes.
        let known = [u].into_iter().chain(last).collect();
        let fit =
            best_response(problem, &tracks, known, if shown.is_empty() || is_last { needed } else { f64::INFINITY })?;
        // An effect that is hidden again at a larger magnitude starts the count anew.
        if fit.cost < needed {
            (before, shown) = (Some((magnitude, fit)), Vec::new());
        // An effect that cannot be simulated at this magnitude cannot at a larger one, either.
        } else {
            shown.push((magnitude, fit));
            if is_last {
                break;
            }
        }
    }
    let Some((magnitude, fit)) = shown.into_iter().next() else { return Ok(None) };
    Ok(Some(match before {
        Some((smaller, less)) => between([smaller, magnitude], [less.cost, fit.cost], needed).unwrap_or(magnitude),
        None => magnitude,
    }))
}

/// Magnitude at which the cost reaches `needed`, between two `magnitudes` with `costs` below and from `needed` on. A power law
/// joins them. None if that is not finite, as for a cost of zero.
fn between([smaller, larger]: [f64; 2], [below, above]: [f64; 2], needed: f64) -> Option<f64> {
    let share = (needed / below).ln() / (above / below).ln();
    let magnitude = smaller * (larger / smaller).powf(share);
    (share.is_finite() && magnitude.is_finite()).then_some(magnitude)
}

/// Noncentrality x that an effect must add to the residual energy of `n` degrees of freedom. The energy is a noncentral
/// chi-square with mean n + x and variance 2 n + 4 x; the test rejects from n + 1.645 sqrt(2 n) on.
fn needed(n: f64) -> f64 {
    let rejected = REJECTED_FROM * (2.0 * n).sqrt();
    let square = IN_FOUR_OF_FIVE.powi(2);
    // Larger root of (x - rejected)^2 = square (2 n + 4 x).
    rejected + 2.0 * square + (4.0 * square * (rejected + square) + 2.0 * n * square).sqrt()
}

/// Best fit of the present model to noise-free data with the effect: from known points, and from everywhere if that fit
/// leaves more than `enough`. A slightly larger effect may fold the object another way, so that the best fit jumps.
fn best_response(problem: &Problem<'_>, tracks: &[Track], known: Vec<&[f64]>, enough: f64) -> Result<Fit, FinderError> {
    let with = |(episode, track): (&MeasuredEpisode, &Track)| episode.with_measured(track.clone());
    let episodes: Vec<MeasuredEpisode> = problem.episodes.iter().zip(tracks).map(with).collect();
    let own = Problem { episodes: &episodes, unknowns: problem.unknowns.clone(), ..*problem };
    let known: Vec<Vec<f64>> = known.into_iter().map(<[f64]>::to_vec).collect();
    let mut go_on = || ControlFlow::Continue(());
    let near = own.best_of(known.clone(), known.len(), &mut go_on)?;
    if near.cost < enough {
        return Ok(near);
    }
    let settings = Settings { draws: DRAWS, starts: STARTS, ..Settings::default() };
    let points = [near.point.clone()].into_iter().chain(known).collect();
    let far = best_fit(&own, points, &settings.of_fits(), &mut go_on)?;
    Ok(if far.cost < near.cost { far } else { near })
}

/// Magnitudes of the search range, in increasing order, with the tracks of the episodes at each; none if a magnitude
/// cannot be simulated.
fn tracks_by_magnitude(problem: &Problem<'_>, u: &[f64], candidate: &Candidate) -> Vec<(f64, Option<Vec<Track>>)> {
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
    use catenary_core::{DifferentiableSimulator, Prior, seed};
    use rand_distr::{Distribution, StandardNormal};
    use track_fit::toy::twisted::folding;
    use track_fit::toy::{self, Toy};

    const TRUTH: [f64; 2] = [0.25, 2e4];

    /// Detectable size of a tip mass in the toy.
    fn size(simulator: &dyn DifferentiableSimulator, gain: f64) -> Option<f64> {
        let episodes = [toy::episode(&Toy { gain }, TRUTH, &[])];
        let problem = Problem::of(&toy::model(), &episodes, simulator, 40);
        let u = problem.unknowns.list().iter().zip(TRUTH).map(|(unknown, value)| unknown.prior.to_unit(value));
        let prior = Prior::LogUniform { low: 1e-3, high: 0.3 };
        let name = "tip_mass_kg".to_owned();
        let candidate = Candidate {
            title: name.clone(),
            name,
            prior,
            range: [0.0, 1.0],
            base: 0.0,
            odds: 1.0,
            companions: Vec::new(),
        };
        detectable_size(&problem, &u.collect::<Vec<_>>(), &candidate).unwrap()
    }

    #[test]
    fn a_size_between_two_magnitudes_follows_the_power_law_of_their_costs() {
        let near = between([1.0, 4.0], [2.0, 32.0], 8.0).unwrap();
        assert!((near - 2.0).abs() < 1e-12, "{near}");
        for costs in [[0.0, 32.0], [2.0, f64::INFINITY], [8.0, 8.0], [f64::NAN, 32.0]] {
            assert!(between([1.0, 4.0], costs, 8.0).is_none_or(|size| (1.0..=4.0).contains(&size)), "{costs:?}");
        }
        assert_eq!(between([1.0, 4.0], [0.0, 32.0], 8.0), None);
    }

    /// The residual of a tip mass m is proportional to m, so that twice the gain halves the detectable size.
    #[test]
    fn a_linear_effect_of_detectable_size_leaves_the_needed_energy() {
        let toy = Toy { gain: 0.3 };
        let found = size(&toy, 0.3).unwrap();
        let episodes = [toy::episode(&toy, TRUTH, &[("tip_mass_kg", found)])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fits = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap();
        let needed = needed((8 * toy::FRAMES - 2) as f64);
        let left = fits[0].as_ref().unwrap().cost;
        assert!((left / needed - 1.0).abs() < 0.05, "{left} of {needed}");
        let half = size(&Toy { gain: 0.6 }, 0.6).unwrap();
        assert!((found / half - 2.0).abs() < 0.1, "{found} {half}");
    }

    #[test]
    fn first_order_limits_are_exact_for_a_linear_effect() {
        let gain = 0.3;
        let toy = Toy { gain };
        let episodes = [toy::episode(&toy, TRUTH, &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
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
            companions: Vec::new(),
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
    fn the_needed_energy_is_rejected_in_four_of_five_draws() {
        let (n, draws) = (100, 4000);
        let (mut rng, limit) = (seed::rng(1, 1), n as f64 + REJECTED_FROM * (2.0 * n as f64).sqrt());
        let each = (needed(n as f64) / n as f64).sqrt();
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut square = |by: f64| (0..n).map(|_| (by + normal()).powi(2)).sum::<f64>();
        let share = |by: f64, square: &mut dyn FnMut(f64) -> f64| {
            (0..draws).filter(|_| square(by) > limit).count() as f64 / draws as f64
        };
        // Standard errors are 0.0034 and 0.0063; the chi-square is slightly skewed.
        let (alarm, power) = (share(0.0, &mut square), share(each, &mut square));
        assert!((0.04..0.07).contains(&alarm) && (0.77..0.83).contains(&power), "{alarm} {power}");
    }

    /// The object folds another way at a hair's breadth of the effect; a slightly shorter object explains that.
    #[test]
    fn an_effect_that_another_fold_explains_is_not_detected() {
        let gain = 0.3;
        let (linear, folding) = (size(&Toy { gain }, gain), size(&folding(Toy { gain }, 0.2498), gain));
        let (linear, folding) = (linear.unwrap(), folding.unwrap());
        assert!(linear > 1e-3 && (folding / linear - 1.0).abs() < 0.2, "{folding}, and without folds {linear}");
    }
}
