//! Best fit from many starts: draws of the priors, draws near known points, and continuation.

use super::excess::leaves_more_than_noise;
use super::problem::{Fit, OnRound, Problem, Start};
use crate::data::MeasuredEpisode;
use crate::error::FitError;
use crate::settings::Settings;
use catenary_core::seed;
use rand::{Rng, RngExt};

/// Random stream, beyond those of the null sets.
const START_STREAM: u64 = 1;
/// Smallest and largest distance of a draw from a known point, in unit coordinates. Distances are uniform in the
/// logarithm.
const REACH: [f64; 2] = [1e-3, 0.1];

/// Every fourth draw covers the whole search range instead of the prior: an effect may exceed its prior.
const BEYOND: usize = 4;

/// Most further searches for a best fit. The next one follows only if the last lowered the cost to 90 % or less.
const SEARCHES: u64 = 5;
const LEFT: f64 = 0.9;
/// Number of searches far within the noise. On the swing of a measured cable they lower the cost from 42 to 34; CMA-ES finds 29.
const SEARCHES_WITHIN_NOISE: u64 = 20;
/// Cost for each residual, in variances of the noise, below which nothing is left to be fitted.
const NOTHING: f64 = 1e-3;
/// Shares of the episodes in a continuation fit, one after the other, and rounds of each of its fits.
const BEGINNINGS: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
pub(super) const FEW_ROUNDS: usize = 12;
/// Points of a batch. Between batches a search may be cancelled, and the cost limit of the next batch is lowered.
const BATCH: usize = 32;
/// Multiple of the wanted starts that is tried if the best ones cannot be linearised.
const TRIES: usize = 4;

/// Best fit of a model: [among draws](fit_among_draws), then by further searches while it leaves more than noise.
///
/// # Errors
/// As [`Problem::best_of`].
pub fn best_fit(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FitError> {
    let first = fit_among_draws(problem, known, settings, on_round)?;
    search_further(problem, first, settings, on_round)
}

/// Best fit of a model, given the best fit among draws. The search goes on while the fit leaves more than noise: first
/// by continuation over the beginnings of the episodes, then from new draws, half of them near the best point. It ends
/// once a search brings little. A search of which no start can be simulated is skipped.
///
/// # Errors
/// [`FitError::Cancelled`] if `on_round` breaks.
pub fn search_further(
    problem: &Problem<'_>,
    mut best: Fit,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FitError> {
    for search in 1..=SEARCHES {
        if !leaves_more_than_noise(&best) {
            break;
        }
        let Some(fit) = further_fit(problem, &best.point, settings, search, on_round)? else { continue };
        let is_less = fit.cost < LEFT * best.cost;
        best = if fit.cost < best.cost { fit } else { best };
        // A continuation that brings nothing does not rule out that new draws do.
        if search > 1 && !is_less {
            break;
        }
    }
    Ok(best)
}

/// Best fit of a model whose `best` fit lies far within the noise. A noise that is stated too large hides that another minimum is
/// far better, and does not tell when to stop. Therefore all searches from new draws are made, half of the draws near the best point.
///
/// # Errors
/// [`FitError::Cancelled`] if `on_round` breaks.
pub fn search_within_noise(
    problem: &Problem<'_>,
    mut best: Fit,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FitError> {
    // The earlier numbers are those of the other searches.
    for search in SEARCHES + 1..=SEARCHES + SEARCHES_WITHIN_NOISE {
        if best.cost < NOTHING * best.residuals.len() as f64 {
            break;
        }
        let fit = further_fit(problem, &best.point, settings, search, on_round)?;
        best = fit.filter(|fit| fit.cost < best.cost).unwrap_or(best);
    }
    Ok(best)
}

/// Best fit from the best of the `known` points and of many draws of the priors.
///
/// # Errors
/// As [`Problem::best_of`].
pub fn fit_among_draws(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FitError> {
    let points = draws(problem, &known, settings, &mut search_rng(settings, 0)).into_iter().chain(known).collect();
    problem.best_of(points, settings.starts, on_round)
}

/// Further search for the best fit, given the point `best`; none if no start of it can be simulated. Search number 1 is the
/// continuation.
fn further_fit(
    problem: &Problem<'_>,
    best: &[f64],
    settings: &Settings,
    search: u64,
    on_round: OnRound<'_>,
) -> Result<Option<Fit>, FitError> {
    let (known, mut rng) = (vec![best.to_vec()], search_rng(settings, search));
    let points = match search {
        1 => continuation(problem, known.clone(), settings, &mut rng, on_round),
        _ => Ok(draws(problem, &known, settings, &mut rng)),
    };
    let fit =
        points.and_then(|points| problem.best_of(points.into_iter().chain(known).collect(), settings.starts, on_round));
    match fit {
        Err(FitError::NoFit(_)) => Ok(None),
        other => other.map(Some),
    }
}

/// Random numbers of a search for the best fit.
fn search_rng(settings: &Settings, search: u64) -> impl Rng + use<> {
    seed::rng(seed::derive(settings.seed, START_STREAM), search)
}

/// Continuation: fits to growing beginnings of the episodes, from `known` points and new draws; returns their last
/// points. An object that folds late is still unfolded in the beginning, so that its fit is not misled by the fold. New
/// draws are made for each share, because the best fits to a beginning may all end in a wrong fold.
fn continuation(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    rng: &mut impl Rng,
    on_round: OnRound<'_>,
) -> Result<Vec<Vec<f64>>, FitError> {
    let mut reached = known;
    for share in BEGINNINGS {
        let episodes: Vec<MeasuredEpisode> = problem.episodes.iter().map(|c| c.beginning(share)).collect();
        let own = Problem { episodes: &episodes, unknowns: problem.unknowns.clone(), rounds: FEW_ROUNDS, ..*problem };
        let points = draws(problem, &reached, settings, rng).into_iter().chain(reached).collect();
        let starts = own.cheapest(points, settings.starts, on_round)?;
        reached = own.fit(starts, on_round)?.into_iter().flatten().map(|fit| fit.point).collect();
    }
    Ok(reached)
}

/// Draws from which fits may start: the middle of the priors, and random points. If points are known, half of the
/// random points lie near them, at all distances: near a fold the cost is as rough close to a point as far from it. Of
/// the others, every fourth covers the whole search range.
pub(super) fn draws(
    problem: &Problem<'_>,
    known: &[Vec<f64>],
    settings: &Settings,
    rng: &mut impl Rng,
) -> Vec<Vec<f64>> {
    let columns = problem.unknowns.columns();
    let near = if known.is_empty() { 0 } else { settings.draws / 2 };
    let mut points = vec![vec![0.5; columns]];
    for about in known.iter().cycle().take(near) {
        // Log-uniform distances, because the width of the minimum is unknown.
        let reach = REACH[0] * (REACH[1] / REACH[0]).powf(rng.random());
        let moved = about.iter().map(|u| (u + reach * (2.0 * rng.random::<f64>() - 1.0)).clamp(0.0, 1.0));
        points.push(moved.collect());
    }
    // A coordinate drawn uniformly is a quantile of the search range; `drawn` maps it to the prior.
    let anywhere = |number: usize| {
        let u: Vec<f64> = (0..columns).map(|_| rng.random()).collect();
        if number.is_multiple_of(BEYOND) { u } else { problem.unknowns.drawn(u) }
    };
    points.extend((near..settings.draws).map(anywhere));
    points
}

impl Problem<'_> {
    /// Best fit to the measured tracks from the `starts` cheapest points. If none of them can be linearised, the next
    /// cheapest are tried.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn best_of(&self, points: Vec<Vec<f64>>, starts: usize, on_round: OnRound<'_>) -> Result<Fit, FitError> {
        let ranked = self.cheapest(points, TRIES * starts, on_round)?;
        let mut refusal = FitError::NoFit("no start was given".into());
        for part in ranked.chunks(starts.max(1)) {
            match self.linearise(part.to_vec(), on_round) {
                Ok(seen) => return self.minimise_best(seen.into_iter().flatten().collect(), on_round),
                Err(none @ FitError::NoFit(_)) => refusal = none,
                Err(other) => return Err(other),
            }
        }
        Err(refusal)
    }

    /// Starts at the `count` cheapest of `points`.
    ///
    /// # Errors
    /// [`FitError::Cancelled`] if `on_round` breaks.
    pub fn cheapest(&self, points: Vec<Vec<f64>>, count: usize, on_round: OnRound<'_>) -> Result<Vec<Start>, FitError> {
        let measured = self.measured();
        let mut ranked: Vec<(f64, Vec<f64>)> = Vec::new();
        let mut rest = points.into_iter().peekable();
        while rest.peek().is_some() {
            let part: Vec<Vec<f64>> = rest.by_ref().take(BATCH).collect();
            // A point above the cost of the `count` best is not needed, so that its simulation may end there.
            let most = count.checked_sub(1).and_then(|last| ranked.get(last)).map_or(f64::INFINITY, |worst| worst.0);
            ranked.extend(self.costs_to(&part, &measured, most).into_iter().zip(part));
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
            ranked.truncate(count);
            if on_round().is_break() {
                return Err(FitError::Cancelled);
            }
        }
        Ok(ranked.into_iter().map(|(_, point)| Start { point, tracks: measured.clone() }).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::twisted::FoldingLate;
    use crate::toy::{self, Toy};
    use catenary_core::simulator::{SimulatorError, TrackSensitivities, Until};
    use catenary_core::{DifferentiableSimulator, SimulationRequest, Simulator, Track};
    use std::ops::ControlFlow;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    #[test]
    fn a_late_fold_is_fitted_by_continuation() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let episodes = [toy::episode(&toy, theta, &[])];
        let folding = FoldingLate { toy, about: theta[0], by: 1e-5 };
        let problem = Problem::of(&toy::model(), &episodes, &folding, 40);
        let settings = Settings { draws: 40, starts: 2, ..Settings::default() };
        let points = draws(&problem, &[], &settings, &mut seed::rng(1, 0));
        let whole = problem.best_of(points, settings.starts, &mut go_on).unwrap();
        assert!(whole.cost > 1e3, "{}: without a fold in the way the test would test nothing", whole.cost);
        let best = best_fit(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let length = problem.unknowns.values(&best.point, 0)[0];
        assert!(best.cost < 1.0 && (length - theta[0]).abs() < 1e-5, "{} at {length}", best.cost);
    }

    /// The stated noise is so large that a fit with a wrong fold lies far within it.
    #[test]
    fn a_fit_far_within_the_noise_is_not_the_last_one() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let mut model = toy::model();
        model.camera.keypoint_noise_px *= 50.0;
        let settings = Settings { draws: 40, starts: 2, ..Settings::default() };
        let episodes = [MeasuredEpisode::new(&model, &toy::measured(&toy, theta, &[]), &settings).unwrap()];
        let folding = FoldingLate { toy, about: theta[0], by: 1e-3 };
        let problem = Problem::of(&model, &episodes, &folding, 40);
        let first = fit_among_draws(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let further = search_further(&problem, first.clone(), &settings, &mut go_on).unwrap();
        assert!(first.cost < 0.5 * first.residuals.len() as f64, "{}: it lies within the noise", first.cost);
        assert_eq!(further.cost, first.cost, "which ends the other search");
        let best = search_within_noise(&problem, first.clone(), &settings, &mut go_on).unwrap();
        assert!(best.cost < 1e-2 * first.cost, "{} after {}", best.cost, first.cost);
    }

    #[test]
    fn half_of_the_draws_lie_near_known_points() {
        let episodes = [toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
        let toy = Toy { gain: 0.3 };
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let settings = Settings { draws: 200, ..Settings::default() };
        let beside = |known: &[Vec<f64>]| {
            let points = draws(&problem, known, &settings, &mut seed::rng(2, 0));
            assert_eq!(points.len(), 201, "and the middle");
            points.iter().filter(|p| p.iter().all(|u| (u - 0.2).abs() <= REACH[1])).count()
        };
        let (none, half) = (beside(&[]), beside(&[vec![0.2; 2]]));
        // A square with half width 0.1 holds one in 25 of the other draws.
        assert!(none < 20 && (100..120).contains(&half), "{none} {half}");
    }

    #[test]
    fn the_next_points_are_tried_if_the_best_cannot_be_linearised() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        // The prior's lengths begin at 0.195 m; the toy refuses lengths under 0.2 m.
        let points = vec![vec![0.0, 0.5], vec![0.01, 0.5], vec![0.5, 0.5]];
        let best = problem.best_of(points.clone(), 1, &mut || ControlFlow::Continue(())).unwrap();
        assert!(best.cost < 0.1, "{}", best.cost);
        let none = problem.best_of(points[..2].to_vec(), 1, &mut || ControlFlow::Continue(()));
        assert!(matches!(none, Err(FitError::NoFit(_))));
    }

    /// Toy that ends its tracks early if asked to, and counts frames.
    struct Ending {
        toy: Toy,
        frames: AtomicUsize,
    }

    impl Simulator for Ending {
        fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
            self.toy.simulate(request)
        }

        fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
            let mut tracks = self.toy.simulate(request)?;
            for (place, track) in tracks.iter_mut().enumerate() {
                let is_enough = |count: &usize| (until.is_enough)(place, &track.frames[..*count]);
                let count = (1..track.frames.len()).find(is_enough).unwrap_or(track.frames.len());
                track.frames.truncate(count);
                self.frames.fetch_add(count, Ordering::Relaxed);
            }
            Ok(tracks)
        }
    }

    impl DifferentiableSimulator for Ending {
        fn sensitivities(
            &self,
            request: &SimulationRequest,
            names: &[&str],
        ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
            self.toy.sensitivities(request, names)
        }
    }

    #[test]
    fn the_cheapest_points_are_found_with_early_ends() {
        let (toy, ending) = (Toy { gain: 0.3 }, Ending { toy: Toy { gain: 0.3 }, frames: AtomicUsize::new(0) });
        let noisy = |i| toy::episode(&toy, [0.25, 2e4], &[]).measured_anew(&mut seed::rng(13, i));
        let episodes = [noisy(0), noisy(1)];
        let mut rng = seed::rng(14, 0);
        // Some points lie near the truth, and some cannot be simulated.
        let near = |i: usize| if i.is_multiple_of(5) { 0.1 } else { 1.0 };
        let points: Vec<Vec<f64>> = (0..200)
            .map(|i| (0..2).map(|_| (0.5 + near(i) * (rng.random::<f64>() - 0.5)).clamp(0.0, 1.0)).collect())
            .collect();
        let found = |simulator: &dyn DifferentiableSimulator, count: usize| {
            let problem = Problem::of(&toy::model(), &episodes, simulator, 40);
            let starts = problem.cheapest(points.clone(), count, &mut || ControlFlow::Continue(())).unwrap();
            starts.into_iter().map(|s| s.point).collect::<Vec<_>>()
        };
        let mut known: Vec<Vec<f64>> = points.clone();
        let costs = Problem::of(&toy::model(), &episodes, &toy, 40);
        let cost = |p: &Vec<f64>| costs.costs(std::slice::from_ref(p), &costs.measured())[0];
        known.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        for count in [0, 1, 8, 32, 199, 200, 300] {
            assert_eq!(found(&ending, count), known[..count.min(200)], "{count}");
        }
        ending.frames.store(0, Ordering::Relaxed);
        found(&ending, 8);
        let refused: Vec<f64> = costs.costs(&[vec![0.0, 0.5], vec![0.5, f64::NAN]], &costs.measured());
        assert_eq!(refused, [f64::INFINITY; 2], "what cannot be simulated, and what is no number");
        let whole = (points.len() - BATCH) * episodes.len() * toy::FRAMES;
        let share = ending.frames.load(Ordering::Relaxed) as f64 / whole as f64;
        assert!(share < 0.6, "{share} of the frames");
    }
}
