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
/// Posterior draws behind the interval of an estimate.
const ESTIMATE_DRAWS: usize = 1000;
/// Share of the draws in an interval, and the quantiles at its ends unless the estimate lies beyond these.
const SHARE: f64 = 0.9;
const ENDS: [f64; 2] = [0.05, 0.95];

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
    let draws: Vec<Vec<f64>> = (0..ESTIMATE_DRAWS).map(|_| posterior.draw(&mut rng)).collect();
    let shared = problem.unknowns.list().iter().enumerate().filter(|(_, u)| u.scope == Scope::Shared);
    let estimate = |(i, u): (usize, &Unknown)| {
        let column = problem.unknowns.column(i, 0);
        let best = fit.point[column];
        let mut sorted: Vec<f64> = draws.iter().map(|draw| draw[column]).collect();
        sorted.sort_by(f64::total_cmp);
        let value = u.prior.from_unit(best);
        let [low, high] = interval(best, &sorted).map(|end| u.prior.from_unit(end));
        // Rounding of the prior's quantiles may move an end across the estimate.
        Estimate { name: u.name.clone(), value, q05: low.min(value), q95: high.max(value) }
    };
    shared.map(estimate).collect()
}

/// Interval of nine tenths of the `sorted` draws that contains the best fit `best`, in unit coordinates: from the 5 % to
/// the 95 % quantile if that contains it, and otherwise the shortest one that does.
///
/// A posterior that is cut off at a bound of the prior has its mode there, beyond the 5 or 95 % quantile. In unit coordinates
/// it is a truncated Gaussian with the best fit as its mode, so that the shortest interval holds its highest densities.
fn interval(best: f64, sorted: &[f64]) -> [f64; 2] {
    let [low, high] = ENDS.map(|q| quantile(sorted, q, QuantileMethod::Nearest));
    if (low..=high).contains(&best) {
        return [low, high];
    }
    let count = ((SHARE * sorted.len() as f64).ceil() as usize).max(1);
    let with_best = sorted.windows(count).map(|held| [held[0].min(best), held[count - 1].max(best)]);
    let length = |[low, high]: &[f64; 2]| high - low;
    with_best.min_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or([best; 2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Model, Prior};
    use nalgebra::{DMatrix, DVector};
    use std::ops::ControlFlow;
    use track_fit::data::Unknowns;
    use track_fit::fitting::Start;
    use track_fit::toy::{self, Toy};

    /// Quantiles of an exponential distribution, whose mode is its least value.
    fn skewed() -> Vec<f64> {
        (0..1000).map(|i| -0.1 * (1.0 - (f64::from(i) + 0.5) / 1000.0).ln()).collect()
    }

    #[test]
    fn an_interval_has_nine_tenths_of_the_draws_and_contains_its_estimate() {
        let (draws, n) = (skewed(), 1000);
        let quantiles = [draws[50], draws[949]];
        assert_eq!(interval(0.1, &draws), quantiles, "the estimate lies between the quantiles");
        assert_eq!(interval(draws[50], &draws), quantiles);
        assert_eq!(interval(0.0, &draws), [0.0, draws[n * 9 / 10 - 1]], "from the mode on");
        assert_eq!(interval(draws[20], &draws), [draws[0], draws[899]], "the densest draws lie beside the estimate");
        // Beyond all draws the interval is longer than it needs to be for them.
        assert_eq!(interval(2.0, &draws), [draws[100], 2.0]);
        let mirrored: Vec<f64> = draws.iter().rev().map(|d| 1.0 - d).collect();
        assert_eq!(interval(1.0, &mirrored), [mirrored[100], 1.0]);
        assert_eq!(interval(0.3, &[0.5]), [0.3, 0.5]);
    }

    /// Parameters with linear and logarithmic priors, and an effect, at bounds and within, known well and badly.
    #[test]
    fn every_estimate_lies_in_its_interval() {
        let model = Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        let prior = Prior::LogUniform { low: 1e-3, high: 0.1 };
        let effect = track_fit::data::Candidate { prior, ..toy::candidate("tip_mass_kg") };
        let simulator = Toy { gain: 0.3 };
        let episodes = [toy::episode(&simulator, [0.25, 2e4], &[])];
        let unknowns = Unknowns::of(&model, 1).with(&effect);
        let problem = Problem { unknowns, ..Problem::of(&model, &episodes, &simulator, 40) };
        let n = problem.unknowns.columns();
        for (known, alike) in [(0.1, 0.0), (5.0, 0.0), (300.0, 0.0), (5.0, 30.0), (300.0, 3000.0)] {
            for u in [0.0, 1e-4, 0.02, 0.5, 0.99, 1.0] {
                let mut jacobian: DMatrix<f64> = known * DMatrix::identity(n, n);
                (jacobian[(0, n - 1)], jacobian[(1, n - 1)]) = (alike, -alike);
                let (residuals, tracks) = (DVector::zeros(n), Vec::new());
                let fit = Fit { point: vec![u; n], cost: 0.0, residuals, jacobian, tracks };
                let posterior = Laplace::of(&fit).unwrap();
                for e in estimates(&problem, &fit, &posterior, &Settings::default()) {
                    assert!(e.q05 <= e.value && e.value <= e.q95 && e.q05 < e.q95, "{known} {alike} {u}: {e:?}");
                }
            }
        }
    }

    /// The measured length lies below the prior.
    #[test]
    fn an_estimate_at_a_bound_is_an_end_of_its_interval() {
        let (simulator, mut model) = (Toy { gain: 0.3 }, toy::model());
        let mut parameters = model.theta.parameters().to_vec();
        parameters[0].prior = Prior::Uniform { low: 0.25, high: 0.3 };
        model.theta = catenary_core::ParameterSpace::new(parameters).unwrap();
        let episodes = [toy::episode(&simulator, [0.249, 2e4], &[])];
        let problem = Problem::of(&model, &episodes, &simulator, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let fit = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        let settings = Settings { seed: 1, ..Settings::default() };
        let found = Agreement::new(&problem, &fit, &model.camera.view, &settings).unwrap().estimates;
        assert_eq!((found[0].value, found[0].q05), (0.25, 0.25), "{found:?}");
        // A half-normal distribution has nine tenths of its mass within 1.645 standard deviations. The standard error of 1000
        // draws is 0.046.
        let sd = 0.05 * Laplace::of(&fit).unwrap().sd(0);
        assert!(((found[0].q95 - 0.25) / sd - 1.645).abs() < 0.15, "{found:?} {sd}");
    }
}
