//! A model with effects more than the present one, fitted.

use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::evidence::{Evidence, Quadratic, Yardstick, sd_of};
use crate::fit::{Fit, OnRound, Problem, Seen, Start};
use crate::laplace::Laplace;
use crate::name::Magnitude;
use crate::unknowns::Unknowns;

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

/// A model with effects more than the present one, fitted.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// The effects, in the order in which they came in; none: the present model.
    pub candidates: Vec<Candidate>,
    /// The unknowns with them: one each, the last.
    pub unknowns: Unknowns,
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
        let own = cost.map_or(f64::INFINITY, |c| sd_of(candidate, &c, i));
        let (low, high) = candidate.search().bounds();
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

    /// What is known of the unknowns about the fit, what conditions differ in among it; none where the curvature is no number.
    pub fn posterior(&self) -> Option<Laplace> {
        Some(Laplace::of(&self.fit)?.widened(self.column(0), &self.spread))
    }

    /// The problem of fitting it.
    pub fn problem<'a>(&self, problem: &Problem<'a>) -> Problem<'a> {
        Problem { unknowns: self.unknowns.clone(), ..*problem }
    }

    /// Looks at this hypothesis with `candidate` added: at its base, and at some values of its prior.
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
        let unknowns = self.unknowns.with(candidate);
        let with = Problem { unknowns: unknowns.clone(), ..*problem };
        let column = unknowns.columns() - 1;
        let search = candidate.search();
        let from = |value: f64| {
            let mut point = unknowns.point_from(&self.unknowns, &self.fit.point);
            point[column] = search.to_unit(value).clamp(0.0, 1.0);
            Start { point, tracks: problem.measured() }
        };
        let starts: Vec<Start> = std::iter::once(candidate.base).chain(candidate.starts()).map(from).collect();
        let seen: Vec<Seen> = with.look(starts, on_round)?.into_iter().flatten().collect();
        if seen.iter().all(|seen| seen.fit.jacobian.column(column).iter().all(|v| *v == 0.0)) {
            return Err(FinderError::NoFit(format!("{} changes nothing that was measured", candidate.title)));
        }
        let mut ranked: Vec<(f64, Seen)> = seen.into_iter().map(|s| (s.fit.clone().descended().cost, s)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(STARTS);
        let promise = ranked.first().map_or(f64::INFINITY, |r| r.0);
        let seen = ranked.into_iter().map(|r| r.1).collect();
        let candidates = self.candidates.iter().chain([candidate]).cloned().collect();
        Ok(Trial { candidates, promise, unknowns, seen })
    }
}

impl Trial {
    /// Whether an effect is among its own.
    pub fn has(&self, name: &str) -> bool {
        self.candidates.iter().any(|c| c.name == name)
    }

    /// Fits it from all starts.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] where there is none to speak of.
    pub fn fitted(
        mut self,
        problem: &Problem<'_>,
        yardstick: &Yardstick,
        on_round: OnRound<'_>,
    ) -> Result<Hypothesis, FinderError> {
        let with = Problem { unknowns: self.unknowns.clone(), ..*problem };
        let fits = with.climb(std::mem::take(&mut self.seen), on_round)?;
        self.hypothesis(fits, yardstick, Depth::Fitted)
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
            fit,
            evidence,
            depth,
            spread: Vec::new(),
        })
    }
}
