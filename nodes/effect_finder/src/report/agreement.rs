//! Agreement of a fit with the data: estimates and distances.

use super::finding::{Estimate, Fitness};
use crate::error::FinderError;
use crate::evidence::Detection;
use crate::settings::Settings;
use catenary_core::statistics::{QuantileMethod, quantile};
use catenary_core::{Camera, seed};
use track_fit::data::{Scope, Unknown, rmse_mm};
use track_fit::fitting::{Fit, Laplace, Problem};

/// Random stream of the estimates.
const ESTIMATE_STREAM: u64 = 2;
/// Posterior draws behind the quantiles of an estimate.
const ESTIMATE_DRAWS: usize = 1000;

/// Agreement of a fit with the data, before its test.
pub struct Agreement {
    /// Estimates of the shared unknowns, with their intervals.
    pub estimates: Vec<Estimate>,
    /// Root mean square distance of keypoints, mm.
    pub rmse_mm: f64,
}

impl Agreement {
    /// Agreement of `fit`, with the Laplace posterior of its unknowns.
    pub fn new(problem: &Problem<'_>, fit: &Fit, camera: &Camera, settings: &Settings) -> Result<Self, FinderError> {
        let posterior = Laplace::of(fit).ok_or_else(FinderError::curvature)?;
        Self::with_posterior(problem, fit, &posterior, camera, settings)
    }

    /// Agreement of `fit`, with a given posterior.
    pub fn with_posterior(
        problem: &Problem<'_>,
        fit: &Fit,
        posterior: &Laplace,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<Self, FinderError> {
        let offsets =
            problem.episodes.iter().zip(&fit.tracks).flat_map(|(episode, track)| episode.offsets_mm(track, camera));
        let rmse_mm = rmse_mm(offsets.collect::<Vec<_>>().iter());
        Ok(Self { estimates: estimates(problem, fit, posterior, settings), rmse_mm })
    }

    /// Agreement together with the test.
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
        let quantile = |q: f64| quantile(&values, q, QuantileMethod::Nearest);
        Estimate { name: u.name.clone(), value: best[i], q05: quantile(0.05), q95: quantile(0.95) }
    };
    shared.map(estimate).collect()
}
