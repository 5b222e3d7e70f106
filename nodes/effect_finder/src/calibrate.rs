//! The best fit of a model to the measured episodes, and what it says.

use crate::detect::Detection;
use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem};
use crate::laplace::Laplace;
use crate::settings::Settings;
use crate::unknowns::{Scope, Unknown};
use crate::verdict::{Estimate, Fitness};
use catenary_core::{Camera, seed};
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
