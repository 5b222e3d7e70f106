//! The best fit of a model to the measured episodes, and what it says.

use crate::case::Case;
use crate::detect::Detection;
use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem, Start};
use crate::hypothesis::Grain;
use crate::laplace::Laplace;
use crate::settings::Settings;
use crate::unknowns::{Scope, Unknown};
use crate::verdict::{Estimate, Fitness};
use catenary_core::{Camera, Fidelity, seed};
use rand::{Rng, RngExt};

/// Random streams, beyond those of the null sets.
const START_STREAM: u64 = 1;
const ESTIMATE_STREAM: u64 = 2;
const VALLEY_STREAM: u64 = 3;
/// Draws behind the quantiles of an estimate.
const ESTIMATE_DRAWS: usize = 1000;

/// Distances from a known point, as shares of what is looked at, within which half of the draws lie: the least and the greatest.
const REACH: [f64; 2] = [1e-3, 0.1];

/// One of so many draws is of all that a search looks at, and not of the priors: an effect may be larger than anyone expected.
const BEYOND: usize = 4;

/// Squared deviations for each coordinate from which on much is left.
pub const MUCH: f64 = 3.0;
/// Standard deviations of the sum of squares by which a fit may exceed the coordinates' number without being looked for further.
const USUAL_SDS: f64 = 1.0;
/// Most further times that a best fit is looked for, and what each must leave of what the last one left for another to follow.
const SEARCHES: u64 = 5;
const LEFT: f64 = 0.9;
/// Shares of the episodes that are followed one after the other, and rounds of each fit.
const BEGINNINGS: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
const FEW_ROUNDS: usize = 12;
/// Draws from which other valleys are looked for, and how many are taken.
const VALLEY_STARTS: usize = 24;
const VALLEYS: usize = 4;

/// The best fit: that [among draws](fit_among_draws); where it leaves more than noise, from where ever more of the beginning of the
/// episodes is followed; and while that leaves more and brings something, from the best of draws of which half lie beside it.
/// Where further draws cannot be simulated it stays as it is.
///
/// # Errors
/// As [`Problem::best_of`].
pub fn best_fit(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FinderError> {
    let first = fit_among_draws(problem, known, settings, on_round)?;
    looked_further(problem, first, settings, on_round)
}

/// The best fit where `best` is that among draws.
///
/// # Errors
/// [`FinderError::Cancelled`] where `on_round` asked to stop.
pub fn looked_further(
    problem: &Problem<'_>,
    mut best: Fit,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FinderError> {
    for search in 1..=SEARCHES {
        if !leaves_more_than_noise(&best) {
            break;
        }
        let fit = match searched(problem, &best.point, settings, search, on_round) {
            Err(FinderError::NoFit(_)) => continue,
            other => other?,
        };
        let is_less = fit.cost < LEFT * best.cost;
        best = if fit.cost < best.cost { fit } else { best };
        if search > 1 && !is_less {
            break;
        }
    }
    Ok(best)
}

/// The best fit from the best of `known` points and of many draws of the priors.
///
/// # Errors
/// As [`Problem::best_of`].
pub fn fit_among_draws(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FinderError> {
    let points = draws(problem, &known, settings, &mut search_rng(settings, 0)).into_iter().chain(known).collect();
    problem.best_of(points, settings.starts, on_round)
}

/// A further look for the best fit, of which `best` is known: the first follows the beginnings of the episodes.
fn searched(
    problem: &Problem<'_>,
    best: &[f64],
    settings: &Settings,
    search: u64,
    on_round: OnRound<'_>,
) -> Result<Fit, FinderError> {
    let (known, mut rng) = (vec![best.to_vec()], search_rng(settings, search));
    let mut points = match search {
        1 => followed(problem, known.clone(), settings, &mut rng, on_round)?,
        _ => draws(problem, &known, settings, &mut rng),
    };
    points.extend(known);
    problem.best_of(points, settings.starts, on_round)
}

/// Randomness of a look for the best fit.
fn search_rng(settings: &Settings, search: u64) -> impl Rng + use<> {
    seed::rng(seed::derive(settings.seed, START_STREAM), search)
}

/// Where fits of ever more of the beginning of the episodes lead to, from `known` points and draws: an object that folds this way or
/// that late in them has not yet in their beginning. Draws are made anew for each share, as what fits the beginning may end in
/// no fold that was measured.
fn followed(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    rng: &mut impl Rng,
    on_round: OnRound<'_>,
) -> Result<Vec<Vec<f64>>, FinderError> {
    let mut reached = known;
    for share in BEGINNINGS {
        let cases: Vec<Case> = problem.cases.iter().map(|c| c.beginning(share)).collect();
        let own = Problem { cases: &cases, unknowns: problem.unknowns.clone(), rounds: FEW_ROUNDS, ..*problem };
        let points = draws(problem, &reached, settings, rng).into_iter().chain(reached).collect();
        let starts = own.cheapest(points, settings.starts, on_round)?;
        reached = own.fit(starts, on_round)?.into_iter().flatten().map(|fit| fit.point).collect();
    }
    Ok(reached)
}

/// Whether a fit leaves more than is usual of noise: a soft object that lies on a table may be taken for another one with the same
/// end, which leaves but little more.
pub fn leaves_more_than_noise(fit: &Fit) -> bool {
    is_beyond_noise(fit, USUAL_SDS)
}

/// Whether the sum of squares exceeds the number of coordinates by more than so many standard deviations of noise.
pub fn is_beyond_noise(fit: &Fit, sds: f64) -> bool {
    let coordinates = fit.residuals.len() as f64;
    fit.cost > coordinates + sds * (2.0 * coordinates).sqrt()
}

/// Whether a fit leaves much more than noise.
pub fn leaves_much(fit: &Fit) -> bool {
    fit.cost > MUCH * fit.residuals.len() as f64
}

/// The middle of the priors and draws of them, or where points are known, half as many and as many beside those; of the draws of
/// the priors some are of all that a search looks at. Where an object folds this way or that by a hair, costs near a point are
/// as rough as far from it.
fn draws(problem: &Problem<'_>, known: &[Vec<f64>], settings: &Settings, rng: &mut impl Rng) -> Vec<Vec<f64>> {
    let columns = problem.unknowns.columns();
    let near = if known.is_empty() { 0 } else { settings.draws / 2 };
    let mut points = vec![vec![0.5; columns]];
    for about in known.iter().cycle().take(near) {
        let reach = REACH[0] * (REACH[1] / REACH[0]).powf(rng.random());
        let moved = about.iter().map(|u| (u + reach * (2.0 * rng.random::<f64>() - 1.0)).clamp(0.0, 1.0));
        points.push(moved.collect());
    }
    let anywhere = |number: usize| {
        let u: Vec<f64> = (0..columns).map(|_| rng.random()).collect();
        if number.is_multiple_of(BEYOND) { u } else { problem.unknowns.drawn(u) }
    };
    points.extend((near..settings.draws).map(anywhere));
    points
}

/// Other valleys of the cost than that in which `best` lies, the lowest first: where fits from the best of draws come to, each
/// behind a ridge from all others.
///
/// # Errors
/// [`FinderError::Cancelled`] where `on_round` asked to stop.
pub fn other_valleys(
    problem: &Problem<'_>,
    best: &[f64],
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Vec<Fit>, FinderError> {
    let points = draws(problem, &[], settings, &mut seed::rng(settings.seed, VALLEY_STREAM));
    let starts = problem.cheapest(points, VALLEY_STARTS, on_round)?;
    let own = Problem { unknowns: problem.unknowns.clone(), rounds: FEW_ROUNDS, ..*problem };
    let mut fits: Vec<Fit> = match own.fit(starts, on_round) {
        Err(FinderError::NoFit(_)) => return Ok(Vec::new()),
        fits => fits?.into_iter().flatten().collect(),
    };
    fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let measured = problem.measured();
    let mut known = vec![(best.to_vec(), problem.costs(&[best.to_vec()], &measured)[0])];
    let mut valleys: Vec<Fit> = Vec::new();
    for fit in fits {
        if valleys.len() == VALLEYS {
            break;
        }
        if known.iter().any(|(point, _)| !problem.unknowns.are_apart(&fit.point, point)) {
            continue;
        }
        let middle = |(point, _): &(Vec<f64>, f64)| point.iter().zip(&fit.point).map(|(a, b)| 0.5 * (a + b)).collect();
        let middles = problem.costs(&known.iter().map(middle).collect::<Vec<_>>(), &measured);
        // Along what the data do not tell a valley is long, and its fits end anywhere in it.
        if middles.iter().zip(&known).all(|(middle, (_, end))| *middle > end.max(fit.cost) + problem.decrease) {
            known.push((fit.point.clone(), fit.cost));
            valleys.push(fit);
        }
        if on_round().is_break() {
            return Err(FinderError::Cancelled("fit"));
        }
    }
    Ok(valleys)
}

/// Rounds of correcting simulated tracks by a finer simulation of the best fit, and fitting again.
const REFINEMENTS: usize = 2;
/// Standard deviations of noise by which a fit to a finer simulation may be worse than that to the coarse one.
const WORSE_SDS: f64 = 3.0;

/// Error of a coarse simulation that is plain in the data, in variances of the noise for each coordinate.
const PLAIN: f64 = 0.2;

/// A fit that a finer simulation was asked for.
pub struct Refined {
    /// The episodes that the fit is to.
    pub cases: Vec<Case>,
    /// The fit.
    pub fit: Fit,
    /// Whether the finer simulation's word is in it.
    pub grain: Grain,
}

/// The episodes, in which simulated tracks are corrected by what a finer simulation of the best fit shows otherwise, and the best
/// fit to them, from `fit` on. Where an object folds this way or that by a hair, the finer simulation may do the other and fit
/// worse by more than noise: then, and where it fails, all stays as it was.
///
/// # Errors
/// [`FinderError::Cancelled`] where `on_round` asked to stop.
pub fn refined(
    problem: &Problem<'_>,
    fit: Fit,
    finer: Fidelity,
    on_round: OnRound<'_>,
) -> Result<Refined, FinderError> {
    let worst = fit.cost + WORSE_SDS * (2.0 * fit.residuals.len() as f64).sqrt();
    let mut best = Refined { cases: problem.cases.to_vec(), fit, grain: Grain::Coarse };
    for _ in 0..REFINEMENTS {
        let next = match next_refined(problem, &best, finer, on_round) {
            Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
            Err(_) => break,
            Ok(next) => next,
        };
        if next.fit.cost > worst {
            break;
        }
        best = next;
    }
    Ok(best)
}

impl Refined {
    /// Whether the error of the coarse simulation is plain in the data: the finer one does not fit, or what it shows otherwise at
    /// the best fit is no small part of the noise.
    pub fn is_too_coarse(&self) -> bool {
        let squares: f64 = self.cases.iter().map(Case::corrected_squares).sum();
        self.grain == Grain::Coarse || squares > PLAIN * self.fit.residuals.len() as f64
    }
}

/// One round of it.
fn next_refined(
    problem: &Problem<'_>,
    last: &Refined,
    finer: Fidelity,
    on_round: OnRound<'_>,
) -> Result<Refined, FinderError> {
    let of = |cases| Problem { cases, unknowns: problem.unknowns.clone(), ..*problem };
    let cases = of(&last.cases).refined(&last.fit.point, finer)?;
    let own = of(&cases);
    let start = Start { point: last.fit.point.clone(), tracks: own.measured() };
    let fits = own.fit(vec![start], on_round)?.into_iter().flatten();
    let fit = fits.last().ok_or_else(|| FinderError::NoFit("the refined fit failed".into()))?;
    Ok(Refined { cases, fit, grain: Grain::Fine })
}

/// How well a fit agrees with the data, before it is tested.
pub struct Agreement {
    /// Values that all episodes share, with their intervals.
    pub estimates: Vec<Estimate>,
    /// Root mean square distance of keypoints, mm.
    pub rmse_mm: f64,
}

impl Agreement {
    /// That of `fit`, seen by `camera`.
    pub fn new(problem: &Problem<'_>, fit: &Fit, camera: &Camera, settings: &Settings) -> Result<Self, FinderError> {
        let posterior = Laplace::of(fit).ok_or_else(FinderError::curvature)?;
        Self::with_posterior(problem, fit, &posterior, camera, settings)
    }

    /// The same where more is known of the uncertainty.
    pub fn with_posterior(
        problem: &Problem<'_>,
        fit: &Fit,
        posterior: &Laplace,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<Self, FinderError> {
        let offsets = problem.cases.iter().zip(&fit.tracks).flat_map(|(case, track)| case.offsets_mm(track, camera));
        let rmse_mm = crate::case::rmse_mm(offsets.collect::<Vec<_>>().iter());
        Ok(Self { estimates: estimates(problem, fit, posterior, settings), rmse_mm })
    }

    /// With its test.
    pub fn with(self, detection: &Detection) -> Fitness {
        Fitness { estimates: self.estimates, test: detection.summary(), rmse_mm: self.rmse_mm }
    }
}

fn estimates(problem: &Problem<'_>, fit: &Fit, posterior: &Laplace, settings: &Settings) -> Vec<Estimate> {
    let mut rng = seed::rng(settings.seed, ESTIMATE_STREAM);
    let draws: Vec<Vec<f64>> =
        (0..ESTIMATE_DRAWS).map(|_| problem.unknowns.values(&posterior.draw(&mut rng), 0)).collect();
    let best = problem.unknowns.values(&fit.point, 0);
    let shared = problem.unknowns.list().iter().enumerate().filter(|(_, u)| u.scope == Scope::Shared);
    let estimate = |(i, u): (usize, &Unknown)| {
        let mut values: Vec<f64> = draws.iter().map(|d| d[i]).collect();
        values.sort_by(f64::total_cmp);
        let quantile = |q: f64| values[(q * (values.len() - 1) as f64).round() as usize];
        Estimate { name: u.name.clone(), value: best[i], q05: quantile(0.05), q95: quantile(0.95) }
    };
    shared.map(estimate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, FoldingLate, Toy, coarse, misleading};
    use std::ops::ControlFlow;

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn rough(problem: &Problem<'_>) -> Fit {
        let settings = Settings { draws: 10, starts: 2, ..Settings::default() };
        best_fit(problem, Vec::new(), &settings, &mut go_on).unwrap()
    }

    #[test]
    fn an_object_that_folds_late_is_followed_from_its_beginning() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let cases = [toy::case(&toy, theta, &[])];
        let folding = FoldingLate { toy, about: theta[0], by: 1e-5 };
        let problem = Problem::of(&toy::model(), &cases, &folding, 40);
        let settings = Settings { draws: 40, starts: 2, ..Settings::default() };
        let points = draws(&problem, &[], &settings, &mut seed::rng(1, 0));
        let whole = problem.best_of(points, settings.starts, &mut go_on).unwrap();
        assert!(whole.cost > 1e3, "{}: without a fold in the way the test would test nothing", whole.cost);
        let best = best_fit(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let length = problem.unknowns.values(&best.point, 0)[0];
        assert!(best.cost < 1.0 && (length - theta[0]).abs() < 1e-5, "{} at {length}", best.cost);
    }

    #[test]
    fn another_valley_than_that_of_the_best_fit_is_seen_once() {
        let (hidden, by) = ("tip_mass_kg", 0.05);
        let simulator = misleading(Toy { gain: 3.0 }, 0.25, hidden, by);
        // With the effect and the fold that undoes it the object looks like one that does not fold.
        let cases = [toy::case(&simulator.toy, [0.24, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &simulator, 40);
        let best = best_fit(&problem, Vec::new(), &Settings::default(), &mut go_on).unwrap();
        let length = |fit: &Fit| problem.unknowns.values(&fit.point, 0)[0];
        assert!(length(&best) >= 0.25, "{}", length(&best));
        let valleys = other_valleys(&problem, &best.point, &Settings::default(), &mut go_on).unwrap();
        let folded: Vec<f64> = valleys.iter().map(length).filter(|l| *l < 0.25).collect();
        assert_eq!(folded.len(), 1, "{:?}", valleys.iter().map(length).collect::<Vec<_>>());
    }

    #[test]
    fn a_valley_along_what_the_data_do_not_tell_is_one() {
        let toy = Toy { gain: 1e-6 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let best = best_fit(&problem, Vec::new(), &Settings::default(), &mut go_on).unwrap();
        let ends = draws(&problem, &[], &Settings::default(), &mut seed::rng(1, 1));
        let far = ends.iter().filter(|end| problem.unknowns.are_apart(end, &best.point)).count();
        assert!(far > ends.len() / 2, "{far} of {}", ends.len());
        let valleys = other_valleys(&problem, &best.point, &Settings::default(), &mut go_on).unwrap();
        assert!(valleys.is_empty(), "{:?}", valleys.iter().map(|v| &v.point).collect::<Vec<_>>());
    }

    #[test]
    fn half_of_the_draws_lie_beside_what_is_known() {
        let cases = [toy::case(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
        let toy = Toy { gain: 0.3 };
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let settings = Settings { draws: 200, ..Settings::default() };
        let beside = |known: &[Vec<f64>]| {
            let points = draws(&problem, known, &settings, &mut seed::rng(2, 0));
            assert_eq!(points.len(), 201, "and the middle");
            points.iter().filter(|p| p.iter().all(|u| (u - 0.2).abs() <= REACH[1])).count()
        };
        let (none, half) = (beside(&[]), beside(&[vec![0.2; 2]]));
        // A square of 0.2 holds one in 25 of the others.
        assert!(none < 20 && (100..120).contains(&half), "{none} {half}");
    }

    /// An episode, of which the tracks of a coarse simulation with that error were measured.
    fn measured_as(toy: &Toy, error: f64, theta: [f64; 2]) -> Case {
        let mut case = toy::case(toy, theta, &[]);
        case.measured.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += error * theta[0]);
        case
    }

    #[test]
    fn a_refined_fit_does_not_feel_the_errors_of_a_coarse_simulation() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let cases = [toy::case(&toy, theta, &[])];
        let error = 0.3;
        let coarse = coarse(toy, error);
        let problem = Problem::of(&toy::model(), &cases, &coarse, 40);
        let rough = rough(&problem);
        let Refined { cases: corrected, fit, grain } =
            refined(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!(grain, Grain::Fine);
        let apart = |fit: &Fit| (problem.unknowns.values(&fit.point, 0)[0] - theta[0]).abs();
        assert!(apart(&fit) < 0.1 * apart(&rough), "{} after {}", apart(&fit), apart(&rough));
        assert!(rough.cost > 10.0 && fit.cost < 0.1 * rough.cost, "{} after {}", fit.cost, rough.cost);
        let none = toy::coarse(Toy { gain: 0.3 }, 0.0);
        let exact = Problem { simulator: &none, unknowns: problem.unknowns.clone(), ..problem };
        let track =
            |p: &Problem<'_>, cases| Problem { cases, unknowns: p.unknowns.clone(), ..*p }.tracks(&[&fit.point]);
        let there = |p: &Problem<'_>, cases| track(p, cases).unwrap()[0][0].frames[3].dlo[0][0];
        let left = (there(&problem, &corrected) - there(&exact, &cases)).abs();
        assert!(left < 2e-2 * error * theta[0], "{left}");
    }

    #[test]
    fn a_finer_simulation_that_fits_worse_by_more_than_noise_changes_nothing() {
        let coarse = coarse(Toy { gain: 0.3 }, 0.3);
        let cases = [measured_as(&coarse.toy, 0.3, [0.25, 2e4])];
        let problem = Problem::of(&toy::model(), &cases, &coarse, 40);
        let rough = rough(&problem);
        let Refined { cases: same, fit, grain } =
            refined(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!((&fit.point, fit.cost, grain), (&rough.point, rough.cost, Grain::Coarse));
        let own = Problem { cases: &same, unknowns: problem.unknowns.clone(), ..problem };
        assert_eq!(own.tracks(&[&fit.point]).unwrap(), problem.tracks(&[&fit.point]).unwrap());
    }

    #[test]
    fn a_finer_simulation_that_fits_worse_by_less_than_noise_is_taken_all_the_same() {
        let coarse = coarse(Toy { gain: 0.3 }, 2e-3);
        let cases = [measured_as(&coarse.toy, 2e-3, [0.25, 2e4])];
        let problem = Problem::of(&toy::model(), &cases, &coarse, 40);
        let rough = rough(&problem);
        let taken = refined(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert!(taken.grain == Grain::Fine && taken.fit.cost > rough.cost, "{} after {}", taken.fit.cost, rough.cost);
    }

    #[test]
    fn a_finer_simulation_that_fails_changes_nothing() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[])];
        let coarse = coarse(toy, f64::NAN);
        let problem = Problem::of(&toy::model(), &cases, &coarse, 40);
        let exact = Toy { gain: 0.3 };
        let rough = rough(&Problem { simulator: &exact, unknowns: problem.unknowns.clone(), ..problem });
        let same = refined(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!((same.fit.point, same.grain), (rough.point, Grain::Coarse));
    }
}
