//! Modes of a posterior: the local minima of the cost that may have a part in it.

use super::excess::noise_inflation;
use super::minima::is_another;
use super::multi_start::{FEW_ROUNDS, draws, search_further};
use super::problem::{Fit, OnRound, Problem, Start};
use crate::error::FitError;
use crate::settings::Settings;
use catenary_core::seed;

/// Random stream of the draws.
const MODES_STREAM: u64 = 5;
/// Cost above the least, beside two for each coordinate, up to which a minimum is kept. At 20 its density is exp(-10) of the
/// greatest; the two for each coordinate allow for wider minima.
const HIGH: f64 = 20.0;
/// Cheap points for each start among which far ones are chosen.
const WIDER: usize = 4;
/// Most modes.
const MOST_MODES: usize = 4;

/// Local minima of the cost that may have a part in the posterior, the lowest first: ends of fits from the cheapest of
/// `known` points, of points near them, and of draws of the priors. The least cost is searched for further while it leaves
/// more than noise.
///
/// # Errors
/// [`FitError::NoFit`] if no start could be simulated, [`FitError::Cancelled`] if `on_round` breaks.
pub fn modes(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Vec<Fit>, FitError> {
    let mut points = draws(problem, &known, settings, &mut seed::rng(settings.seed, MODES_STREAM));
    points.extend(known);
    let cheap = problem.cheapest(points, WIDER * settings.starts, on_round)?;
    let starts = spread_out(cheap, settings.starts);
    let few = Problem { unknowns: problem.unknowns.clone(), rounds: FEW_ROUNDS, ..*problem };
    let mut fits: Vec<Fit> = few.fit(starts, on_round)?.into_iter().flatten().collect();
    fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let best = polished(problem, &fits[0], on_round)?;
    let best = search_further(problem, best, settings, on_round)?;
    let most = best.cost + noise_inflation(&best) * (HIGH + 2.0 * best.point.len() as f64);
    let mut known = vec![(best.point.clone(), best.cost)];
    let mut modes = vec![best];
    for fit in fits {
        if modes.len() == MOST_MODES || fit.cost > most {
            break;
        }
        if is_another(problem, &known, &fit) {
            known.push((fit.point.clone(), fit.cost));
            modes.push(fit);
        }
        if on_round().is_break() {
            return Err(FitError::Cancelled);
        }
    }
    Ok(modes)
}

/// `count` of these starts, which are in order of their costs: the cheapest half, then those farthest from all before. The
/// cheapest points alone often lie in one minimum.
fn spread_out(mut starts: Vec<Start>, count: usize) -> Vec<Start> {
    let rest = starts.split_off(starts.len().min(count.div_ceil(2)));
    let squared = |a: &Start, b: &Start| a.point.iter().zip(&b.point).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mut left: Vec<(f64, Start)> = rest.into_iter().map(|start| (f64::INFINITY, start)).collect();
    let mut new = 0;
    while starts.len() < count && !left.is_empty() {
        for (nearest, start) in &mut left {
            *nearest = starts[new..].iter().map(|other| squared(start, other)).fold(*nearest, f64::min);
        }
        new = starts.len();
        let farthest = (0..left.len()).max_by(|a, b| left[*a].0.total_cmp(&left[*b].0)).unwrap_or(0);
        starts.push(left.swap_remove(farthest).1);
    }
    starts
}

/// Fit that goes on from another one to the end.
fn polished(problem: &Problem<'_>, fit: &Fit, on_round: OnRound<'_>) -> Result<Fit, FitError> {
    let start = Start { point: fit.point.clone(), tracks: problem.measured() };
    Ok(problem.fit(vec![start], on_round)?.into_iter().flatten().next().unwrap_or_else(|| fit.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::twisted::Mirrored;
    use crate::toy::{self, Toy};
    use std::ops::ControlFlow;

    #[test]
    fn modes_are_the_minima_that_share_the_posterior() {
        let mut go_on = || ControlFlow::Continue(());
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.24, 2e4], &[])];
        let few = Settings { draws: 100, ..Settings::default() };
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        assert_eq!(modes(&problem, Vec::new(), &few, &mut go_on).unwrap().len(), 1);
        // A mirror makes two minima of one.
        let mirrored = Mirrored { toy: Toy { gain: 0.3 }, at: 0.25 };
        let episodes = [toy::episode(&toy, [0.265, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &mirrored, 40);
        let found = modes(&problem, Vec::new(), &few, &mut go_on).unwrap();
        let mut lengths: Vec<f64> = found.iter().map(|fit| problem.unknowns.values(&fit.point, 0)[0]).collect();
        lengths.sort_by(f64::total_cmp);
        assert!(
            lengths.len() == 2 && (lengths[0] - 0.235).abs() < 1e-4 && (lengths[1] - 0.265).abs() < 1e-4,
            "{lengths:?}"
        );
    }
}
