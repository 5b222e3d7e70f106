//! The best fit of a model to the measured episodes, and what it says.

use crate::case::Case;
use crate::detect::Detection;
use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem, Start};
use crate::laplace::Laplace;
use crate::settings::Settings;
use crate::unknowns::{Scope, Unknown};
use crate::verdict::{Estimate, Fitness};
use catenary_core::{Camera, Fidelity, seed};
use rand::RngExt;

/// Random streams, beyond those of the null sets.
const START_STREAM: u64 = 1;
const ESTIMATE_STREAM: u64 = 2;
/// Draws behind the quantiles of an estimate.
const ESTIMATE_DRAWS: usize = 1000;

/// The best fit: from the best of many draws of the prior, and of `known` points.
pub fn best_fit(
    problem: &Problem<'_>,
    known: Vec<Vec<f64>>,
    settings: &Settings,
    on_round: OnRound<'_>,
) -> Result<Fit, FinderError> {
    let columns = problem.unknowns.columns();
    let mut rng = seed::rng(settings.seed, START_STREAM);
    let draws = (0..settings.draws).map(|_| (0..columns).map(|_| rng.random::<f64>()).collect());
    let points = [vec![0.5; columns]].into_iter().chain(known).chain(draws).collect();
    problem.best_of(points, settings.starts, on_round)
}

/// Rounds of correcting simulated tracks by a finer simulation of the best fit, and fitting again.
const REFINEMENTS: usize = 2;

/// The episodes, in which simulated tracks are corrected by what a finer simulation of the best fit shows otherwise, and the best
/// fit to them, from `fit` on. Where an object folds this way or that, the finer simulation may do the other and fit worse: then
/// the correction and the fit stay as they were.
pub fn refined(
    problem: &Problem<'_>,
    fit: Fit,
    finer: Fidelity,
    on_round: OnRound<'_>,
) -> Result<(Vec<Case>, Fit), FinderError> {
    let (mut cases, mut last) = (problem.cases.to_vec(), fit.clone());
    let mut best = (cases.clone(), fit);
    for _ in 0..REFINEMENTS {
        let of = |cases| Problem { cases, unknowns: problem.unknowns.clone(), ..*problem };
        let corrected = of(&cases).refined(&last.point, finer)?;
        let own = of(&corrected);
        let start = Start { point: last.point, tracks: own.measured() };
        let fits = own.fit(vec![start], on_round)?.into_iter().flatten();
        last = fits.last().ok_or_else(|| FinderError::NoFit("the refined fit failed".into()))?;
        cases = corrected;
        if last.cost < best.1.cost {
            best = (cases.clone(), last.clone());
        }
    }
    Ok(best)
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
    use crate::toy::{self, Coarse, Toy};
    use std::ops::ControlFlow;

    #[test]
    fn a_refined_fit_does_not_feel_the_errors_of_a_coarse_simulation() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let cases = [toy::case(&toy, theta, &[])];
        let coarse = Coarse { toy, error: 0.3 };
        let problem = Problem::of(&toy::model(), &cases, &coarse, 40);
        let mut go_on = || ControlFlow::Continue(());
        let settings = Settings { draws: 10, starts: 2, ..Settings::default() };
        let rough = best_fit(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let (corrected, fit) = refined(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        let apart = |fit: &Fit| (problem.unknowns.values(&fit.point, 0)[0] - theta[0]).abs();
        assert!(apart(&fit) < 0.1 * apart(&rough), "{} after {}", apart(&fit), apart(&rough));
        assert!(rough.cost > 10.0 && fit.cost < 0.1 * rough.cost, "{} after {}", fit.cost, rough.cost);
        let none = Coarse { toy: Toy { gain: 0.3 }, error: 0.0 };
        let exact = Problem { simulator: &none, unknowns: problem.unknowns.clone(), ..problem };
        let track =
            |p: &Problem<'_>, cases| Problem { cases, unknowns: p.unknowns.clone(), ..*p }.tracks(&[&fit.point]);
        let there = |p: &Problem<'_>, cases| track(p, cases).unwrap()[0][0].frames[3].dlo[0][0];
        let left = (there(&problem, &corrected) - there(&exact, &cases)).abs();
        assert!(left < 1e-2 * coarse.error * theta[0], "{left}");
    }
    #[test]
    fn a_finer_simulation_that_fits_worse_changes_nothing() {
        let (toy, theta) = (Toy { gain: 0.3 }, [0.25, 2e4]);
        let mut case = toy::case(&toy, theta, &[]);
        let coarse = Coarse { toy, error: 0.3 };
        // What was measured is what the coarse simulation shows.
        case.measured.frames.iter_mut().flat_map(|f| f.dlo.iter_mut()).for_each(|p| p[0] += coarse.error * theta[0]);
        let cases = [case];
        let problem = Problem::of(&toy::model(), &cases, &coarse, 40);
        let mut go_on = || ControlFlow::Continue(());
        let settings = Settings { draws: 10, starts: 2, ..Settings::default() };
        let rough = best_fit(&problem, Vec::new(), &settings, &mut go_on).unwrap();
        let (same, fit) = refined(&problem, rough.clone(), Fidelity::Reference, &mut go_on).unwrap();
        assert_eq!((&fit.point, fit.cost), (&rough.point, rough.cost));
        let own = Problem { cases: &same, unknowns: problem.unknowns.clone(), ..problem };
        assert_eq!(own.tracks(&[&fit.point]).unwrap(), problem.tracks(&[&fit.point]).unwrap());
    }
}
