//! Other local minima of a fit's cost.

use super::multi_start::{FEW_ROUNDS, draws};
use super::problem::{Fit, OnRound, Problem};
use crate::error::FitError;
use crate::settings::Settings;
use catenary_core::seed;

/// Random stream of the draws.
const MINIMA_STREAM: u64 = 3;
/// Starts from which other local minima are searched, and most minima that are returned.
const MINIMA_STARTS: usize = 24;
const MOST_MINIMA: usize = 4;

/// Other local minima of the cost than `best`, the lowest first: ends of fits from the best draws. Each is separated
/// from all others by a higher cost halfway between them.
///
/// # Errors
/// [`FitError::Cancelled`] if `on_round` breaks.
pub fn other_minima(
    problem: &Problem<'_>,
    best: &[f64],
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Vec<Fit>, FitError> {
    let points = draws(problem, &[], settings, &mut seed::rng(settings.seed, MINIMA_STREAM));
    let starts = problem.cheapest(points, MINIMA_STARTS, on_round)?;
    let own = Problem { unknowns: problem.unknowns.clone(), rounds: FEW_ROUNDS, ..*problem };
    let mut fits: Vec<Fit> = match own.fit(starts, on_round) {
        Err(FitError::NoFit(_)) => return Ok(Vec::new()),
        fits => fits?.into_iter().flatten().collect(),
    };
    fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let measured = problem.measured();
    let mut known = vec![(best.to_vec(), problem.costs(&[best.to_vec()], &measured)[0])];
    // A fit that ended near a known minimum is the same minimum.
    let mut minima: Vec<Fit> = Vec::new();
    for fit in fits {
        if minima.len() == MOST_MINIMA {
            break;
        }
        if is_another(problem, &known, &fit) {
            known.push((fit.point.clone(), fit.cost));
            // Later ends in the same minimum must find it among the known ones.
            minima.push(fit);
        }
        if on_round().is_break() {
            return Err(FitError::Cancelled);
        }
    }
    Ok(minima)
}

/// Returns whether a fit ended in another minimum than the `known` ones, each a point with its cost.
pub(super) fn is_another(problem: &Problem<'_>, known: &[(Vec<f64>, f64)], fit: &Fit) -> bool {
    if known.iter().any(|(point, _)| !problem.unknowns.are_apart(&fit.point, point)) {
        return false;
    }
    let middle = |(point, _): &(Vec<f64>, f64)| point.iter().zip(&fit.point).map(|(a, b)| 0.5 * (a + b)).collect();
    let middles = problem.costs(&known.iter().map(middle).collect::<Vec<_>>(), &problem.measured());
    // Without a ridge halfway, both points lie in one long minimum along a direction that the data leave open.
    middles.iter().zip(known).all(|(middle, (_, end))| *middle > end.max(fit.cost) + problem.decrease)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::best_fit;
    use crate::toy::twisted::misleading;
    use crate::toy::{self, Toy};
    use std::ops::ControlFlow;

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    #[test]
    fn another_local_minimum_is_found_once() {
        let (hidden, by) = ("tip_mass_kg", 0.05);
        let simulator = misleading(Toy { gain: 3.0 }, 0.25, hidden, by);
        // The fold hides the effect: an object with both looks like one with neither.
        let episodes = [toy::episode(&simulator.toy, [0.24, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &simulator, 40);
        let best = best_fit(&problem, Vec::new(), &Settings::default(), &mut go_on).unwrap();
        let length = |fit: &Fit| problem.unknowns.values(&fit.point, 0)[0];
        assert!(length(&best) >= 0.25, "{}", length(&best));
        let minima = other_minima(&problem, &best.point, &Settings::default(), &mut go_on).unwrap();
        let folded: Vec<f64> = minima.iter().map(length).filter(|l| *l < 0.25).collect();
        assert_eq!(folded.len(), 1, "{:?}", minima.iter().map(length).collect::<Vec<_>>());
    }

    #[test]
    fn ends_along_an_undetermined_direction_are_one_minimum() {
        let toy = Toy { gain: 1e-6 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let best = best_fit(&problem, Vec::new(), &Settings::default(), &mut go_on).unwrap();
        let ends = draws(&problem, &[], &Settings::default(), &mut seed::rng(1, 1));
        let far = ends.iter().filter(|end| problem.unknowns.are_apart(end, &best.point)).count();
        assert!(far > ends.len() / 2, "{far} of {}", ends.len());
        let minima = other_minima(&problem, &best.point, &Settings::default(), &mut go_on).unwrap();
        assert!(minima.is_empty(), "{:?}", minima.iter().map(|v| &v.point).collect::<Vec<_>>());
    }
}
