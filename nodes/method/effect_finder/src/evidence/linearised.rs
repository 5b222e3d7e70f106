//! Candidate models before their fit: linearised at their starting points.

use super::hypothesis::{Effort, Hypothesis, problem_with};
use super::marginal::Baseline;
use crate::error::FinderError;
use nalgebra::DMatrix;
use std::sync::Arc;
use track_fit::data::{Candidate, MeasuredEpisode, Unknowns};
use track_fit::fitting::{FidelityCorrection, Fit, Known, LinearisedStart, OnRound, Problem, Start};

/// Starts from which a candidate model is fitted: the best of all linearised ones.
const STARTS: usize = 2;

/// Candidate model linearised at its starting points, not fitted yet.
#[derive(Debug, Clone)]
pub struct LinearisedModel {
    /// Effects of the model.
    pub candidates: Vec<Candidate>,
    /// Lowest cost of the linearised model: a prediction of the cost of its fit.
    pub predicted_cost: f64,
    unknowns: Unknowns,
    episodes: Option<Arc<[MeasuredEpisode]>>,
    seen: Vec<LinearisedStart>,
}

impl Hypothesis {
    /// This model with `candidate` added, not linearised yet.
    pub fn extended_by(&self, candidate: &Candidate) -> LinearisedModel {
        let candidates = self.candidates.iter().chain([candidate]).cloned().collect();
        let (unknowns, episodes) = (self.unknowns.with(candidate), self.episodes.clone());
        LinearisedModel { candidates, predicted_cost: f64::INFINITY, unknowns, episodes, seen: Vec::new() }
    }

    /// Linearises this model with `candidate` added, at the candidate's base and at its starting values, each with all settings
    /// of its companions. Derivatives by the other unknowns are taken from this model's fit.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] if the effect has nothing to act on in this model, or changes nothing in these data. An
    /// effect that acts at random changes nothing, because fits simulate without noise.
    pub fn linearised_with(
        &self,
        problem: &Problem<'_>,
        candidate: &Candidate,
        on_round: OnRound<'_>,
    ) -> Result<LinearisedModel, FinderError> {
        let trial = self.extended_by(candidate);
        let (with, unknowns) = (trial.problem(problem), &trial.unknowns);
        let (column, companions) = (unknowns.columns() - 1, unknowns.companions_of(&candidate.name));
        let search = candidate.search();
        let settings = candidate.settings();
        let from = |(value, setting): (f64, &Vec<f64>)| {
            let mut point = unknowns.point_from(&self.unknowns, &self.fit.point);
            point[column] = search.to_unit(value).clamp(0.0, 1.0);
            companions.iter().zip(setting).for_each(|(column, u)| point[*column] = *u);
            Start { point, tracks: problem.measured() }
        };
        // At the base the model is the present one: its derivative there shows small effects.
        let values = std::iter::once(candidate.base).chain(candidate.starts());
        let starts = values.flat_map(|value| settings.iter().map(move |setting| (value, setting))).map(from).collect();
        let known = Known { unknowns: &self.unknowns, jacobian: &self.fit.jacobian };
        let seen: Vec<LinearisedStart> = with.linearise_new(starts, known, on_round)?.into_iter().flatten().collect();
        if changes_nothing(&seen) {
            return Err(FinderError::NoFit(format!("{} changes nothing that was measured", candidate.title)));
        }
        Ok(LinearisedModel { seen, ..trial }.ranked())
    }
}

/// Returns whether the last unknown has no derivative at any start.
fn changes_nothing(seen: &[LinearisedStart]) -> bool {
    let is_zero = |j: &DMatrix<f64>| j.column(j.ncols() - 1).iter().all(|v| *v == 0.0);
    seen.iter().all(|seen| is_zero(&seen.fit.jacobian))
}

impl LinearisedModel {
    fn problem<'a>(&'a self, problem: &Problem<'a>) -> Problem<'a> {
        problem_with(problem, &self.unknowns, self.episodes.as_deref())
    }

    /// Keeps the most promising starts.
    fn ranked(mut self) -> Self {
        let mut ranked: Vec<(f64, LinearisedStart)> =
            self.seen.into_iter().map(|s| (s.fit.clone().linear_minimum().cost, s)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(STARTS);
        self.predicted_cost = ranked.first().map_or(f64::INFINITY, |r| r.0);
        self.seen = ranked.into_iter().map(|r| r.1).collect();
        self
    }

    /// Linearises the model at the best of `draws`: rows of one prior quantile an unknown.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] if none of the draws can be simulated; [`FinderError::Cancelled`] if `on_round` breaks.
    pub fn at_draws(
        mut self,
        problem: &Problem<'_>,
        draws: &[Vec<f64>],
        on_round: OnRound<'_>,
    ) -> Result<Self, FinderError> {
        let with = self.problem(problem);
        let points = draws.iter().map(|d| self.unknowns.drawn(d.clone())).collect();
        let starts = with.cheapest(points, STARTS, on_round)?;
        self.seen = with.linearise(starts, on_round)?.into_iter().flatten().collect();
        if let Some(candidate) = self.candidates.last().filter(|_| changes_nothing(&self.seen)) {
            return Err(FinderError::NoFit(format!("{} changes nothing there", candidate.title)));
        }
        Ok(self.ranked())
    }

    /// Returns whether the model has the named effect.
    pub fn has(&self, name: &str) -> bool {
        self.candidates.iter().any(|c| c.name == name)
    }

    /// Fits the model from all starts. `aim` is the cost of the best other model: a fit far above it ends sooner.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] if no start can be fitted.
    pub fn fitted(
        mut self,
        problem: &Problem<'_>,
        aim: f64,
        baseline: &Baseline,
        on_round: OnRound<'_>,
    ) -> Result<Hypothesis, FinderError> {
        let start = |seen: LinearisedStart| Start { point: seen.fit.point, tracks: seen.tracks };
        let starts = std::mem::take(&mut self.seen).into_iter().map(start).collect();
        // The starts were linearised with borrowed derivatives, so that they are linearised again.
        let own = Problem { aim, ..self.problem(problem) };
        let seen = own.linearise(starts, on_round)?.into_iter().flatten().collect();
        let fit = own.minimise_best(seen, on_round)?;
        self.hypothesis(vec![fit], baseline, Effort::Fitted)
    }

    /// Judges the model by its linearised minimum, without a fit.
    ///
    /// # Errors
    /// As [`LinearisedModel::fitted`].
    pub fn judged(mut self, baseline: &Baseline) -> Result<Hypothesis, FinderError> {
        let fits = std::mem::take(&mut self.seen).into_iter().map(|s| s.fit.linear_minimum()).collect();
        self.hypothesis(fits, baseline, Effort::Linearised)
    }

    fn hypothesis(self, fits: Vec<Fit>, baseline: &Baseline, effort: Effort) -> Result<Hypothesis, FinderError> {
        let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let fit = best.ok_or_else(|| FinderError::NoFit("no start was left".into()))?;
        let evidence = baseline.of(&self.candidates, &fit);
        let evidence = evidence.ok_or_else(|| FinderError::NoFit("the curvature is no positive matrix".into()))?;
        Ok(Hypothesis {
            candidates: self.candidates,
            unknowns: self.unknowns,
            episodes: self.episodes,
            correction: FidelityCorrection::Untried,
            fit,
            evidence,
            effort,
            spread: Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::ControlFlow;
    use track_fit::toy::{self, Toy, candidate};

    #[test]
    fn draws_are_linearised_at_the_best_that_can_be_simulated() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let candidate = candidate("tip_mass_kg");
        let unknowns = problem.unknowns.with(&candidate);
        let truth = problem.unknowns.list()[1].prior.to_unit(2e4);
        let mut go_on = || ControlFlow::Continue(());
        let empty = LinearisedModel {
            candidates: vec![candidate.clone()],
            predicted_cost: f64::INFINITY,
            unknowns,
            episodes: None,
            seen: Vec::new(),
        };
        // The prior's lengths begin at 0.195 m; the toy refuses lengths under 0.2 m.
        let (short, long) = (vec![0.0, truth, 0.5], vec![0.5, truth, 0.8]);
        let seen = empty.clone().at_draws(&problem, &[short.clone(), long.clone()], &mut go_on).unwrap();
        assert_eq!(seen.seen.len(), 1);
        let value = candidate.search().from_unit(seen.seen[0].fit.point[2]);
        assert!(
            (value - candidate.drawn(0.8)).abs() < 1e-12 && seen.predicted_cost < 1e-6,
            "{value} {}",
            seen.predicted_cost
        );
        assert!(matches!(empty.at_draws(&problem, &[short], &mut go_on), Err(FinderError::NoFit(_))));
    }
}
