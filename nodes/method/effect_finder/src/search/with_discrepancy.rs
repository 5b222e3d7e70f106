//! Fit of effects that leave a residual: their sizes and uncertainties with the residual counted as a discrepancy.

use super::context::{LEAST_DECREASE, Search};
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Baseline, Hypothesis, Whitening};
use crate::report::{Agreement, Fitness, sentences};
use track_fit::data::Scope;
use track_fit::fitting::{Fit, Laplace, Problem, Start, best_fit};

/// Most Gauss-Newton steps of a fit with a discrepancy.
const REWEIGHINGS: usize = 10;

impl Search<'_> {
    /// Model with sizes and uncertainties that count the residual of the fitted and of the validation episodes as more
    /// than noise. Its agreement is put into `fitness`.
    pub(super) fn fit_with_discrepancy(
        &mut self,
        hypothesis: Hypothesis,
        fitness: &mut Fitness,
        baseline: &Baseline,
    ) -> Result<Hypothesis, FinderError> {
        let mut best = self.refit_whitened(hypothesis, baseline)?;
        let own = best.magnitudes();
        let elsewhere = self.measure_spread(&mut best, baseline)?;
        self.reporter.conclude(Stage::Repair, sentences::weighed(&own, elsewhere.as_deref(), &best.magnitudes()))?;
        let posterior = best.posterior().ok_or_else(FinderError::curvature)?;
        let (problem, camera) = (best.problem(self.problem), &self.question.model.camera.view);
        let agreement = Agreement::with_posterior(&problem, &best.fit, &posterior, camera, self.settings)?;
        (fitness.estimates, fitness.rmse_mm) = (agreement.estimates, agreement.rmse_mm);
        Ok(best)
    }

    /// Model fitted with the likeliest discrepancy, so that the uncertainty of its effects counts the residual.
    fn refit_whitened(&mut self, hypothesis: Hypothesis, baseline: &Baseline) -> Result<Hypothesis, FinderError> {
        let Some(place) = hypothesis.evidence.likeliest() else { return Ok(hypothesis) };
        let own = hypothesis.problem(self.problem);
        let fit = self.minimise_whitened(&own, hypothesis.fit.clone(), baseline.whitening(place))?;
        Ok(Hypothesis { fit, ..hypothesis })
    }

    /// Best fit under `whitening`, from `fit` on: Gauss-Newton with step halving.
    fn minimise_whitened(&mut self, own: &Problem<'_>, fit: Fit, whitening: &Whitening) -> Result<Fit, FinderError> {
        let mut best = whitening.of(&fit);
        let mut share = 1.0;
        for _ in 0..REWEIGHINGS {
            let minimum = best.clone().linear_minimum();
            if best.cost - minimum.cost < LEAST_DECREASE {
                break;
            }
            let point = best.point.iter().zip(&minimum.point).map(|(from, to)| from + share * (to - from)).collect();
            let start = Start { point, tracks: own.measured() };
            let seen = self.reporter.with_progress(Stage::Repair, |on_round| own.linearise(vec![start], on_round));
            match seen.map(|seen| seen.into_iter().flatten().next().map(|seen| whitening.of(&seen.fit))) {
                Err(cancelled @ FinderError::Cancelled(_)) => return Err(cancelled),
                Ok(Some(lower)) if lower.cost < best.cost => (best, share) = (lower, 1.0),
                // The step overshot, or its end cannot be simulated.
                _ => share *= 0.5,
            }
        }
        Ok(best)
    }

    /// Fits the model to the validation episodes alone, and takes the excess differences of its shared unknowns as their
    /// spread between conditions: a model with a residual has slightly other values in each motion. One difference is all the
    /// data there is. Returns the values of the effects in the validation episodes.
    fn measure_spread(&mut self, best: &mut Hypothesis, baseline: &Baseline) -> Result<Option<Vec<f64>>, FinderError> {
        let Some(place) = best.evidence.likeliest().filter(|_| !self.validation.is_empty()) else { return Ok(None) };
        let (verifier, settings) = (self.verifier(), self.settings);
        let mut episodes = Vec::new();
        for episode in self.validation {
            episodes.push(
                self.reporter.with_progress(Stage::Repair, |on_round| verifier.fitted(episode, best, on_round))?.0,
            );
        }
        let unknowns = best.unknowns.for_episodes(episodes.len());
        let known = vec![unknowns.shared_from(&best.unknowns, &best.fit.point)];
        let own = Problem { episodes: &episodes, unknowns, ..*self.problem };
        let fit = match self
            .reporter
            .with_progress(Stage::Repair, |on_round| best_fit(&own, known, &settings.of_fits(), on_round))
        {
            // Validation episodes that cannot be simulated say nothing about the spread.
            Err(FinderError::NoFit(_)) => return Ok(None),
            other => other?,
        };
        let whitening = Whitening::new(&episodes, baseline.discrepancies[place]).ok_or_else(FinderError::curvature)?;
        let fit = self.minimise_whitened(&own, fit, &whitening)?;
        let there = Hypothesis { unknowns: own.unknowns, fit, ..best.clone() };
        let (here, other) = (Laplace::of(&best.fit), Laplace::of(&there.fit));
        let (here, other) = here.zip(other).ok_or_else(FinderError::curvature)?;
        let spread = |own: usize, far: usize| {
            let apart = best.fit.point[own] - there.fit.point[far];
            // The difference of two draws of a Gaussian has twice its variance.
            (0.5 * (apart.powi(2) - here.sd(own).powi(2) - other.sd(far).powi(2)).max(0.0)).sqrt()
        };
        let mut spreads = vec![0.0; best.unknowns.columns()];
        for (i, _) in best.unknowns.list().iter().enumerate().filter(|(_, u)| u.scope == Scope::Shared) {
            let (own, far) = (best.unknowns.column(i, 0), there.unknowns.column(i, 0));
            spreads[own] = spread(own, far);
        }
        best.spread = spreads;
        Ok(Some((0..there.candidates.len()).map(|i| there.magnitude(i).0).collect()))
    }
}
