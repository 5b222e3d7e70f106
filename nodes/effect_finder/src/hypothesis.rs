//! A model with effects more than the present one, fitted.

use crate::candidate::Candidate;
use crate::case::Case;
use crate::error::FinderError;
use crate::evidence::{Evidence, Quadratic, Yardstick, sd_of};
use crate::fit::{Fit, OnRound, Problem, Seen, Start, presses};
use crate::laplace::Laplace;
use crate::name::Magnitude;
use crate::unknowns::Unknowns;
use nalgebra::DMatrix;
use std::sync::Arc;

/// Starts from which an effect is fitted, of all that are looked at those that promise most.
const STARTS: usize = 2;

/// How well the best fit is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// As a linear simulator would have it, from where the fit would start.
    Promised,
    /// From the most promising starts.
    Fitted,
    /// From the best of some draws of the priors, too.
    Glanced,
    /// Looked for in the whole support of the priors.
    Polished,
}

/// Whether a fit counts what a finer simulation of its own model shows otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grain {
    /// None was asked for yet.
    Unasked,
    /// It does.
    Fine,
    /// The finer simulation does not fit, or there is none.
    Coarse,
}

/// A model with effects more than the present one, fitted.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// The effects, in the order in which they came in; none: the present model.
    pub candidates: Vec<Candidate>,
    /// The unknowns with them: one each, the last.
    pub unknowns: Unknowns,
    /// The fitted episodes, with the correction of simulated tracks that the fit is to; none: the search's, by the present model.
    pub cases: Option<Arc<[Case]>>,
    /// Whether that correction is its own.
    pub grain: Grain,
    /// The best fit.
    pub fit: Fit,
    /// Its evidence over the present model's.
    pub evidence: Evidence,
    /// How well the best fit is known.
    pub depth: Depth,
    /// Standard deviation of each effect between conditions, in unit coordinates; empty where it is not known.
    pub spread: Vec<f64>,
}

/// A hypothesis that was looked at where its fit would start.
#[derive(Debug, Clone)]
pub struct Trial {
    /// The effects.
    pub candidates: Vec<Candidate>,
    /// The cost that it would come to if the simulator were linear.
    pub promise: f64,
    unknowns: Unknowns,
    cases: Option<Arc<[Case]>>,
    seen: Vec<Seen>,
}

impl Hypothesis {
    /// The names of its effects.
    pub fn names(&self) -> Vec<&str> {
        self.candidates.iter().map(|c| c.name.as_str()).collect()
    }

    /// Whether both have the same effects.
    pub fn is_same(&self, candidates: &[Candidate]) -> bool {
        self.candidates.len() == candidates.len() && candidates.iter().all(|c| self.has(&c.name))
    }

    /// Whether an effect is among its own.
    pub fn has(&self, name: &str) -> bool {
        self.candidates.iter().any(|c| c.name == name)
    }

    /// The column of effect `i`.
    pub fn column(&self, i: usize) -> usize {
        self.unknowns.columns() - self.candidates.len() + i
    }

    /// Value and standard deviation of effect `i`, all other unknowns free, with how much it differs between conditions.
    pub fn magnitude(&self, i: usize) -> (f64, f64) {
        let candidate = &self.candidates[i];
        let cost = Quadratic::of(&self.fit, self.candidates.len());
        let (low, high) = candidate.search().bounds();
        // Where the data say next to nothing, it lies anywhere that a search looks at.
        let most = (high - low) / 12f64.sqrt();
        let own = cost.map_or(most, |c| sd_of(candidate, &c, i).min(most));
        let value = candidate.search().from_unit(self.fit.point[self.column(i)]);
        (value, own.hypot((high - low) * self.spread.get(i).copied().unwrap_or(0.0)))
    }

    /// Each effect with its value and standard deviation.
    pub fn magnitudes(&self) -> Vec<Magnitude> {
        let one = |(i, candidate): (usize, &Candidate)| {
            let (value, sd) = self.magnitude(i);
            Magnitude { name: candidate.name.clone(), title: candidate.title.clone(), value, sd }
        };
        self.candidates.iter().enumerate().map(one).collect()
    }

    /// An effect at the [limit](Candidate::limit_at) of its range, which would fit better beyond it, and its value.
    pub fn at_its_limit(&self) -> Option<(&Candidate, f64)> {
        let gradient = self.fit.gradient();
        self.candidates.iter().enumerate().find_map(|(i, candidate)| {
            let column = self.column(i);
            let u = self.fit.point[column];
            candidate.limit_at(u).filter(|_| presses(u, gradient[column])).map(|limit| (candidate, limit))
        })
    }

    /// Points to fit this hypothesis from where `other` fits: what both have is as there, and of its own effects each in turn at
    /// the values at which fits start. A fit from elsewhere may have come to rest in another valley.
    pub fn where_fits(&self, other: &Hypothesis) -> Vec<Vec<f64>> {
        let there = self.unknowns.point_from(&other.unknowns, &other.fit.point);
        let own = |i: &usize| !other.has(&self.candidates[*i].name);
        let mut settled = there;
        for i in (0..self.candidates.len()).filter(own) {
            settled[self.column(i)] = self.fit.point[self.column(i)];
        }
        let moved = |i: usize| {
            let (column, candidate, settled) = (self.column(i), &self.candidates[i], &settled);
            candidate.starts().into_iter().map(move |value| {
                let mut point = settled.clone();
                point[column] = candidate.search().to_unit(value).clamp(0.0, 1.0);
                point
            })
        };
        let mut points: Vec<Vec<f64>> = (0..self.candidates.len()).filter(own).flat_map(moved).collect();
        points.push(settled);
        points
    }

    /// What is known of the unknowns about the fit, what conditions differ in among it; none where the curvature is no number.
    pub fn posterior(&self) -> Option<Laplace> {
        Some(Laplace::of(&self.fit)?.widened(self.column(0), &self.spread))
    }

    /// The problem of fitting it.
    pub fn problem<'a>(&'a self, problem: &Problem<'a>) -> Problem<'a> {
        with_own(problem, &self.unknowns, self.cases.as_deref())
    }

    /// This hypothesis with `candidate` added, not looked at anywhere yet.
    pub fn aside(&self, candidate: &Candidate) -> Trial {
        let candidates = self.candidates.iter().chain([candidate]).cloned().collect();
        let (unknowns, cases) = (self.unknowns.with(candidate), self.cases.clone());
        Trial { candidates, promise: f64::INFINITY, unknowns, cases, seen: Vec::new() }
    }

    /// Looks at this hypothesis with `candidate` added: at its base, and at some values of its prior. What the other unknowns
    /// change is as it is without it.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] where the model has nothing for the effect to act on, or it changes nothing in these data: an
    /// effect that acts at random does not, as fits are without noise.
    pub fn with(
        &self,
        problem: &Problem<'_>,
        candidate: &Candidate,
        on_round: OnRound<'_>,
    ) -> Result<Trial, FinderError> {
        let trial = self.aside(candidate);
        let (with, unknowns) = (trial.problem(problem), &trial.unknowns);
        let column = unknowns.columns() - 1;
        let search = candidate.search();
        let from = |value: f64| {
            let mut point = unknowns.point_from(&self.unknowns, &self.fit.point);
            point[column] = search.to_unit(value).clamp(0.0, 1.0);
            Start { point, tracks: problem.measured() }
        };
        let starts: Vec<Start> = std::iter::once(candidate.base).chain(candidate.starts()).map(from).collect();
        let seen: Vec<Seen> = with.glance(starts, &self.fit.jacobian, on_round)?.into_iter().flatten().collect();
        if changes_nothing(&seen) {
            return Err(FinderError::NoFit(format!("{} changes nothing that was measured", candidate.title)));
        }
        Ok(Trial { seen, ..trial }.ranked())
    }
}

/// The problem with these unknowns, and these cases where there are any.
fn with_own<'a>(problem: &Problem<'a>, unknowns: &Unknowns, cases: Option<&'a [Case]>) -> Problem<'a> {
    Problem { unknowns: unknowns.clone(), cases: cases.unwrap_or(problem.cases), ..*problem }
}

/// Whether the last unknown changes nothing at any of these.
fn changes_nothing(seen: &[Seen]) -> bool {
    let is_zero = |j: &DMatrix<f64>| j.column(j.ncols() - 1).iter().all(|v| *v == 0.0);
    seen.iter().all(|seen| is_zero(&seen.fit.jacobian))
}

impl Trial {
    fn problem<'a>(&'a self, problem: &Problem<'a>) -> Problem<'a> {
        with_own(problem, &self.unknowns, self.cases.as_deref())
    }

    /// The most promising starts.
    fn ranked(mut self) -> Self {
        let mut ranked: Vec<(f64, Seen)> = self.seen.into_iter().map(|s| (s.fit.clone().descended().cost, s)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(STARTS);
        self.promise = ranked.first().map_or(f64::INFINITY, |r| r.0);
        self.seen = ranked.into_iter().map(|r| r.1).collect();
        self
    }

    /// Looks at the best of `draws`, rows of a quantile of each unknown's prior.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] where none of them can be simulated; [`FinderError::Cancelled`] where `on_round` asked to stop.
    pub fn elsewhere(
        mut self,
        problem: &Problem<'_>,
        draws: &[Vec<f64>],
        on_round: OnRound<'_>,
    ) -> Result<Self, FinderError> {
        let with = self.problem(problem);
        let points = draws.iter().map(|d| self.unknowns.drawn(d.clone())).collect();
        let starts = with.cheapest(points, STARTS, on_round)?;
        self.seen = with.look(starts, on_round)?.into_iter().flatten().collect();
        if let Some(candidate) = self.candidates.last().filter(|_| changes_nothing(&self.seen)) {
            return Err(FinderError::NoFit(format!("{} changes nothing there", candidate.title)));
        }
        Ok(self.ranked())
    }

    /// Whether an effect is among its own.
    pub fn has(&self, name: &str) -> bool {
        self.candidates.iter().any(|c| c.name == name)
    }

    /// Fits it from all starts, the less carefully the further it lies above `aim`, the cost that another came to.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] where there is none to speak of.
    pub fn fitted(
        mut self,
        problem: &Problem<'_>,
        aim: f64,
        yardstick: &Yardstick,
        on_round: OnRound<'_>,
    ) -> Result<Hypothesis, FinderError> {
        let start = |seen: Seen| Start { point: seen.fit.point, tracks: seen.tracks };
        let starts = std::mem::take(&mut self.seen).into_iter().map(start).collect();
        let own = Problem { aim, ..self.problem(problem) };
        let seen = own.look(starts, on_round)?.into_iter().flatten().collect();
        let fit = own.race(seen, on_round)?;
        self.hypothesis(vec![fit], yardstick, Depth::Fitted)
    }

    /// What it comes to if the simulator is linear.
    ///
    /// # Errors
    /// As [`Trial::fitted`].
    pub fn promised(mut self, yardstick: &Yardstick) -> Result<Hypothesis, FinderError> {
        let fits = std::mem::take(&mut self.seen).into_iter().map(|s| s.fit.descended()).collect();
        self.hypothesis(fits, yardstick, Depth::Promised)
    }

    fn hypothesis(self, fits: Vec<Fit>, yardstick: &Yardstick, depth: Depth) -> Result<Hypothesis, FinderError> {
        let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let fit = best.ok_or_else(|| FinderError::NoFit("no start was left".into()))?;
        let evidence = yardstick.of(&self.candidates, &fit);
        let evidence = evidence.ok_or_else(|| FinderError::NoFit("the curvature is no positive matrix".into()))?;
        Ok(Hypothesis {
            candidates: self.candidates,
            unknowns: self.unknowns,
            cases: self.cases,
            grain: Grain::Unasked,
            fit,
            evidence,
            depth,
            spread: Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};
    use catenary_core::Prior;
    use std::ops::ControlFlow;

    fn candidate(name: &str) -> Candidate {
        let prior = Prior::LogUniform { low: 1e-3, high: 0.1 };
        Candidate { name: name.into(), title: name.into(), prior, range: [0.0, 1.0], base: 0.0, odds: 1.0 }
    }

    /// The hypothesis of one effect, fitted to data with a tip mass of 0.05 from one start.
    fn fitted(problem: &Problem<'_>, name: &str, start: f64) -> Hypothesis {
        let candidate = candidate(name);
        let unknowns = problem.unknowns.with(&candidate);
        let with = Problem { unknowns: unknowns.clone(), ..*problem };
        let start = Start { point: vec![start; unknowns.columns()], tracks: problem.measured() };
        let fit = with.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap().remove(0).unwrap();
        let evidence = Evidence { alone: 0.0, with: Vec::new() };
        Hypothesis {
            candidates: vec![candidate],
            unknowns,
            cases: None,
            grain: Grain::Unasked,
            fit,
            evidence,
            depth: Depth::Fitted,
            spread: Vec::new(),
        }
    }

    #[test]
    fn a_fit_from_where_another_fits_begins_with_its_theta_and_all_values_of_the_own_effect() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let (other, own) = (fitted(&problem, "tip_mass_kg", 0.5), fitted(&problem, "linear_drag_n_s_m2", 0.4));
        let points = own.where_fits(&other);
        assert_eq!(points.len(), own.candidates[0].starts().len() + 1);
        for point in &points {
            let pairs = point[..2].iter().zip(&other.fit.point);
            assert!(pairs.fold(0.0, |most: f64, (a, b)| most.max((a - b).abs())) < 1e-9, "{point:?}");
        }
        assert_ne!(own.fit.point[..2], other.fit.point[..2], "the wrong effect bends theta");
        let search = own.candidates[0].search();
        let mut values: Vec<f64> = points.iter().map(|p| search.from_unit(p[2])).collect();
        let settled = values.pop().unwrap();
        assert!((settled - own.magnitude(0).0).abs() < 1e-9);
        assert!(values.iter().zip(own.candidates[0].starts()).all(|(a, b)| (a - b).abs() < 1e-9), "{values:?}");
        // Where the other has the effect, too, its value there is known.
        let [point] = own.where_fits(&own).try_into().unwrap();
        assert!(point.iter().zip(&own.fit.point).all(|(a, b)| (a - b).abs() < 1e-9), "{point:?}");
    }

    #[test]
    fn an_effect_is_at_its_limit_where_it_would_go_beyond() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let mut there = fitted(&problem, "tip_mass_kg", 0.5);
        there.candidates[0].range = [0.0, 0.3];
        assert!(there.at_its_limit().is_none(), "it lies within");
        let column = there.column(0);
        there.fit.point[column] = 1.0;
        for (towards, limit) in [(1.0, Some(0.3)), (-1.0, None)] {
            there.fit.residuals = towards * there.fit.jacobian.column(column).into_owned();
            let found = there.at_its_limit().map(|(_, limit)| limit);
            assert!(found.is_some() == limit.is_some() && found.zip(limit).is_none_or(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    #[test]
    fn what_the_data_do_not_tell_is_no_less_certain_than_the_range_of_the_search() {
        let toy = Toy { gain: 1e-9 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let (_, sd) = fitted(&problem, "tip_mass_kg", 0.5).magnitude(0);
        // The search goes to three times the prior.
        assert!((sd - 0.3 / 12f64.sqrt()).abs() < 1e-9, "{sd}");
    }

    #[test]
    fn a_look_elsewhere_is_at_the_best_of_draws_that_can_be_simulated() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let candidate = candidate("tip_mass_kg");
        let unknowns = problem.unknowns.with(&candidate);
        let truth = problem.unknowns.list()[1].prior.to_unit(2e4);
        let mut go_on = || ControlFlow::Continue(());
        let empty = Trial {
            candidates: vec![candidate.clone()],
            promise: f64::INFINITY,
            unknowns,
            cases: None,
            seen: Vec::new(),
        };
        // Lengths begin at 0.195 m; the toy has none under 0.2 m.
        let (short, long) = (vec![0.0, truth, 0.5], vec![0.5, truth, 0.8]);
        let seen = empty.clone().elsewhere(&problem, &[short.clone(), long.clone()], &mut go_on).unwrap();
        assert_eq!(seen.seen.len(), 1);
        let value = candidate.search().from_unit(seen.seen[0].fit.point[2]);
        assert!((value - candidate.drawn(0.8)).abs() < 1e-12 && seen.promise < 1e-6, "{value} {}", seen.promise);
        assert!(matches!(empty.elsewhere(&problem, &[short], &mut go_on), Err(FinderError::NoFit(_))));
    }
}
