//! Candidate models with one effect, linearised at the present fit and elsewhere.

use super::context::{LEAST_DECREASE, Search};
use super::progress::Stage;
use crate::error::FinderError;
use crate::evidence::{Baseline, Effort, Hypothesis, LinearisedModel, lowest_cost};
use catenary_core::seed;
use rand::RngExt;
use track_fit::data::Candidate;
use track_fit::fitting::{FidelityCorrection, OnRound, leaves_much, other_minima};

/// Reduction of the number of draws for a search elsewhere, and its random stream.
const ELSEWHERE: usize = 6;
const ELSEWHERE_STREAM: u64 = 2207;
/// Most starting places from which one effect is fitted.
const MOST_TRIALS: usize = 2;
/// Least predicted decrease of the cost for which a further effect is fitted.
pub(super) const LEAST_PREDICTED_DECREASE: f64 = 1.0;

impl<'a> Search<'a> {
    /// Present model linearised with one effect.
    pub(super) fn linearised_single(
        &mut self,
        base: &Hypothesis,
        candidate: &Candidate,
    ) -> Result<LinearisedModel, FinderError> {
        let problem = self.problem;
        // Beside a large gap the correction at the present fit is far from that at the candidate's fit.
        let from = if leaves_much(&base.fit) { &self.uncorrected(base) } else { base };
        self.reporter.with_progress(Stage::Name, |on_round| from.linearised_with(problem, candidate, on_round))
    }

    /// Adds models with one effect whose fit is better far from the present model's fit. An effect may have its minimum
    /// in another basin, or change nothing near the present fit.
    pub(super) fn search_elsewhere(
        &mut self,
        hypotheses: &mut Vec<Hypothesis>,
        base: &Hypothesis,
        baseline: &Baseline,
    ) -> Result<(), FinderError> {
        // A linearised model has no cost to compare with.
        let known_cost = |all: &[Hypothesis], candidate: &Candidate| {
            let is_known = |h: &&Hypothesis| h.effort != Effort::Linearised && h.has(&candidate.name);
            all.iter().find(is_known).map_or(base.fit.cost, |h| h.fit.cost)
        };
        // Beside a large gap a fidelity correction is negligible.
        let needs_correction = base.correction == FidelityCorrection::Applied && !leaves_much(&base.fit);
        let uncorrected = self.uncorrected(base);
        let mut trials = self.linearised_at_minima(&uncorrected)?;
        if leaves_much(&base.fit) {
            trials.extend(self.linearised_at_draws(&uncorrected)?);
        }
        let is_promising = |all: &[Hypothesis], candidate: &Candidate, trial: &LinearisedModel| {
            trial.predicted_cost < known_cost(all, candidate) - LEAST_PREDICTED_DECREASE
        };
        trials.retain(|(candidate, trial)| is_promising(hypotheses, candidate, trial));
        trials.sort_by(|(_, a), (_, b)| a.predicted_cost.total_cmp(&b.predicted_cost));
        let mut seen: Vec<&str> = Vec::new();
        trials.retain(|(candidate, _)| {
            // At most some places of each effect are fitted, so that one effect does not use up all fits.
            seen.push(&candidate.name);
            seen.iter().filter(|name| **name == candidate.name).count() <= MOST_TRIALS
        });
        trials.truncate(self.settings.extensions);
        for (candidate, trial) in trials {
            if !is_promising(hypotheses, candidate, &trial) {
                continue;
            }
            let (aim, problem) = (lowest_cost(hypotheses), self.problem);
            let is_less = |h: &Hypothesis| h.fit.cost < known_cost(hypotheses, candidate) - LEAST_DECREASE;
            let fitted =
                self.reporter.with_progress(Stage::Name, |on_round| trial.fitted(problem, aim, baseline, on_round));
            let found = match fitted {
                Ok(one) if is_less(&one) && needs_correction => Some(self.correct(&one, baseline)?)
                    .filter(|h| h.correction == FidelityCorrection::Applied && is_less(h)),
                Ok(one) => Some(one).filter(is_less),
                Err(FinderError::NoFit(_)) => None,
                Err(other) => return Err(other),
            };
            if let Some(found) = found {
                hypotheses.retain(|h| !h.has(&candidate.name));
                hypotheses.push(found);
            }
        }
        Ok(())
    }

    /// Linearises each candidate at the other local minima of the present model: the missing effect may have led its
    /// fit into the wrong one.
    fn linearised_at_minima(
        &mut self,
        uncorrected: &Hypothesis,
    ) -> Result<Vec<(&'a Candidate, LinearisedModel)>, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let own = uncorrected.problem(problem);
        let minima = self.reporter.with_progress(Stage::Name, |on_round| {
            other_minima(&own, &uncorrected.fit.point, &settings.of_fits(), on_round)
        })?;
        let mut trials = Vec::new();
        for fit in minima {
            let there = Hypothesis { fit, ..uncorrected.clone() };
            trials.extend(
                self.linearise_each(|candidate, on_round| there.linearised_with(problem, candidate, on_round))?,
            );
        }
        Ok(trials)
    }

    /// Linearises each candidate at the best of some draws of all priors.
    fn linearised_at_draws(
        &mut self,
        uncorrected: &Hypothesis,
    ) -> Result<Vec<(&'a Candidate, LinearisedModel)>, FinderError> {
        let (problem, settings) = (self.problem, self.settings);
        let mut rng = seed::rng(settings.seed, ELSEWHERE_STREAM);
        self.linearise_each(|candidate, on_round| {
            let columns = uncorrected.unknowns.columns() + candidate.companions.len() + 1;
            let mut draw = |_| (0..columns).map(|_| rng.random()).collect();
            let draws: Vec<Vec<f64>> = (0..settings.draws.div_ceil(ELSEWHERE)).map(&mut draw).collect();
            uncorrected.extended_by(candidate).at_draws(problem, &draws, on_round)
        })
    }

    /// Linearises each candidate by `linearise`, without those that cannot be simulated.
    fn linearise_each(
        &mut self,
        mut linearise: impl FnMut(&Candidate, OnRound<'_>) -> Result<LinearisedModel, FinderError>,
    ) -> Result<Vec<(&'a Candidate, LinearisedModel)>, FinderError> {
        let candidates = self.question.candidates;
        let mut trials = Vec::new();
        for (place, candidate) in candidates.iter().enumerate() {
            self.reporter.report(Stage::Name, 0.5 * place as f64 / candidates.len() as f64, None)?;
            match self.reporter.with_progress(Stage::Name, |on_round| linearise(candidate, on_round)) {
                Ok(trial) => trials.push((candidate, trial)),
                Err(FinderError::NoFit(_)) => (),
                Err(other) => return Err(other),
            }
        }
        Ok(trials)
    }
}
