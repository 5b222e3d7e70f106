//! Which effects explain the disagreement: models with some of them, held against each other by their evidence.

use crate::error::FinderError;
use crate::fit::{Problem, Start};
use crate::hypothesis::Hypothesis;
use crate::settings::Settings;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// How many times as far behind an effect may be that changes the same as the best one: what tells them apart then is as
/// likely an error of the noise's model.
const ALIKE: f64 = 3.0;

/// An effect with its size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Magnitude {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Its name in a sentence.
    pub title: String,
    /// Its value at the best fit, in its unit.
    pub value: f64,
    /// Standard deviation of it, all other unknowns free; where something is left, with how much it differs between conditions.
    pub sd: f64,
}

/// What one effect, or some together, explain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// The effects.
    pub effects: Vec<Magnitude>,
    /// Sum of the squared residuals with them.
    pub statistic: f64,
    /// Logarithm of the evidence with them over the evidence without.
    pub log_bayes_factor: f64,
    /// Probability that they are all there is to explain.
    pub probability: f64,
    /// Probability that they are present, and something besides that no candidate is.
    pub probability_in_part: f64,
    /// Cosine between what the one effect by which this differs from the best explanation changes and what that one's
    /// changes instead, beyond what all other unknowns can change; 1 for the best itself, 0 where more than one differs.
    pub cosine_with_best: f64,
}

impl Explanation {
    /// The names of its effects, joined.
    pub fn names(&self) -> String {
        self.effects.iter().map(|e| e.name.as_str()).collect::<Vec<_>>().join(" + ")
    }
}

/// Hypotheses in order of their probability.
#[derive(Debug, Clone)]
pub struct Ranking {
    /// The hypotheses.
    pub hypotheses: Vec<Hypothesis>,
    /// What each explains, in the same order.
    pub explanations: Vec<Explanation>,
    /// Probability that the present model is all there is.
    pub none: f64,
    /// Probability that none of the candidates is present, but something else.
    pub unknown: f64,
}

/// Whether effects explain all, or a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// What they leave is noise.
    Whole,
    /// They leave something that no candidate explains.
    Part,
}

/// Logarithm of how probable a hypothesis is as all there is, and with something besides that no candidate is; over a constant.
fn logs(h: &Hypothesis, candidates: usize, settings: &Settings) -> [f64; 2] {
    let further = (settings.further_effect / candidates.max(1) as f64).ln();
    let odds: f64 = h.candidates.iter().map(|c| c.odds.ln()).sum();
    let prior = odds + further * h.candidates.len().saturating_sub(1) as f64;
    let share = settings.discrepancy_share;
    [h.evidence.alone + (1.0 - share).ln(), h.evidence.with_any() + share.ln()].map(|log| prior + log)
}

/// By how much `new` is more probable than `old`, two fits of one hypothesis, in nats.
pub fn gain(old: &Hypothesis, new: &Hypothesis, settings: &Settings) -> f64 {
    log_sum_exp(&logs(new, 1, settings)) - log_sum_exp(&logs(old, 1, settings))
}

impl Ranking {
    /// How far the hypothesis at `place` is behind the most probable one, in nats.
    pub fn behind(&self, place: usize) -> f64 {
        let log = |e: &Explanation| (e.probability + e.probability_in_part).ln();
        log(&self.explanations[0]) - log(&self.explanations[place])
    }

    /// Puts hypotheses in order. Beforehand, none and each candidate alone are as likely by their odds; further effects and
    /// discrepancies as the settings say.
    ///
    /// # Errors
    /// [`FinderError`] of the simulator.
    pub fn new(
        problem: &Problem<'_>,
        base: &Hypothesis,
        mut hypotheses: Vec<Hypothesis>,
        candidates: usize,
        settings: &Settings,
    ) -> Result<Self, FinderError> {
        let logs = |h: &Hypothesis| logs(h, candidates, settings);
        let greater = |h: &Hypothesis| log_sum_exp(&logs(h));
        hypotheses.sort_by(|a, b| greater(b).total_cmp(&greater(a)));
        let [none, unknown] = logs(base);
        let all: Vec<[f64; 2]> = hypotheses.iter().map(logs).collect();
        let total = log_sum_exp(&all.iter().flatten().copied().chain([none, unknown]).collect::<Vec<_>>());
        let cosines = cosines(problem, &hypotheses)?;
        let explanation = |((h, logs), cosine): ((&Hypothesis, &[f64; 2]), f64)| Explanation {
            effects: h.magnitudes(),
            statistic: h.fit.cost,
            log_bayes_factor: h.evidence.alone,
            probability: (logs[0] - total).exp(),
            probability_in_part: (logs[1] - total).exp(),
            cosine_with_best: cosine,
        };
        let explanations = hypotheses.iter().zip(&all).zip(cosines).map(explanation).collect();
        Ok(Self { hypotheses, explanations, none: (none - total).exp(), unknown: (unknown - total).exp() })
    }

    /// Logarithm of how many times as probable `one` is as `other`, in whole or in part.
    pub fn log_odds(&self, one: &Hypothesis, other: &Hypothesis) -> f64 {
        let log = |wanted: &Hypothesis| {
            let place = self.hypotheses.iter().position(|h| h.is_same(&wanted.candidates));
            let explanation = place.map(|i| &self.explanations[i]);
            explanation.map_or(f64::NEG_INFINITY, |e| (e.probability + e.probability_in_part).ln())
        };
        log(one) - log(other)
    }

    /// The most probable hypothesis, and whether it explains all; none where that is none of them.
    pub fn best(&self) -> Option<(&Hypothesis, Extent)> {
        let (hypothesis, explanation) = (self.hypotheses.first()?, self.explanations.first()?);
        let [whole, part] = [explanation.probability, explanation.probability_in_part];
        let extent = if whole >= part { Extent::Whole } else { Extent::Part };
        (whole.max(part) > self.none.max(self.unknown)).then_some((hypothesis, extent))
    }

    /// Those that the data do not tell from the best: nearly as probable, or not far behind and changing the same. One that
    /// has further effects beside all of the best's is not among them: it explains no more. The best is the first.
    pub fn alike(&self, settings: &Settings) -> Vec<&Hypothesis> {
        let Some((best, extent)) = self.best() else { return Vec::new() };
        let log = |e: &Explanation| match extent {
            Extent::Whole => e.probability.ln(),
            Extent::Part => e.probability_in_part.ln(),
        };
        let best_log = log(&self.explanations[0]);
        let least = settings.least_log_bayes_factor;
        let is_like = |(h, e): &(&Hypothesis, &Explanation)| {
            let behind = best_log - log(e);
            let is_more = h.candidates.len() > best.candidates.len() && best.names().iter().all(|n| h.has(n));
            let explains = e.log_bayes_factor > 0.0 && !is_more;
            explains && (behind < least || (e.cosine_with_best > settings.greatest_cosine && behind < ALIKE * least))
        };
        let others = self.hypotheses.iter().zip(&self.explanations).skip(1).filter(is_like).map(|(h, _)| h);
        std::iter::once(best).chain(others).collect()
    }
}

/// For each effect of the first, what stands for it in others that differ in that effect alone; those that differ in more
/// stand, whole, beside the first effect.
pub fn groups(alike: &[&Hypothesis]) -> Vec<Vec<String>> {
    let Some((best, others)) = alike.split_first() else { return Vec::new() };
    let mut groups: Vec<Vec<String>> = best.names().into_iter().map(|n| vec![n.to_owned()]).collect();
    for other in others {
        match one_for_one(best, other) {
            Some((i, j)) => groups[i].push(other.candidates[j].name.clone()),
            None => groups[0].push(other.names().join(" + ")),
        }
    }
    groups
}

/// Which effect of `best` another has in place of which, where that is all in which they differ: their places.
fn one_for_one(best: &Hypothesis, other: &Hypothesis) -> Option<(usize, usize)> {
    let missing = |of: &Hypothesis, from: &Hypothesis| -> Vec<usize> {
        (0..of.candidates.len()).filter(|&i| !from.has(&of.candidates[i].name)).collect()
    };
    match (missing(best, other).as_slice(), missing(other, best).as_slice()) {
        ([i], [j]) => Some((*i, *j)),
        _ => None,
    }
}

/// [`Explanation::cosine_with_best`] of each, at the best one's fit.
fn cosines(problem: &Problem<'_>, hypotheses: &[Hypothesis]) -> Result<Vec<f64>, FinderError> {
    let Some(best) = hypotheses.first() else { return Ok(Vec::new()) };
    let swaps: Vec<Option<(usize, usize)>> = hypotheses.iter().map(|h| one_for_one(best, h)).collect();
    // The best one's effects come first: `with` appends, so that every other has a column of its own at the end.
    let mut unknowns = best.unknowns.clone();
    let mut others = Vec::new();
    for (h, swap) in hypotheses.iter().zip(&swaps) {
        if let Some((_, j)) = swap {
            unknowns = unknowns.with(&h.candidates[*j]);
            others.push(&h.candidates[*j]);
        }
    }
    let mut point = unknowns.point_from(&best.unknowns, &best.fit.point);
    let first = unknowns.columns() - others.len();
    for (i, other) in others.iter().enumerate() {
        point[first + i] = other.search().to_unit(other.base).clamp(0.0, 1.0);
    }
    let all = Problem { unknowns, ..*problem };
    let start = Start { point, tracks: problem.measured() };
    let nothing = Ok(vec![0.0; hypotheses.len()]);
    let seen = match all.look(vec![start], &mut || ControlFlow::Continue(())) {
        // Where a linear simulator would have the best fit, there may be nothing that can be simulated.
        Err(FinderError::NoFit(_)) => return nothing,
        seen => seen?.into_iter().flatten().next(),
    };
    let Some(seen) = seen else { return nothing };
    let jacobian = seen.fit.jacobian;
    let mut next = first;
    let mut of = |(place, swap): (usize, &Option<(usize, usize)>)| {
        let Some((i, _)) = swap else { return if place == 0 { 1.0 } else { 0.0 } };
        let own = best.column(*i);
        let rest: Vec<usize> = (0..first).filter(|&c| c != own).collect();
        let span = jacobian.select_columns(&rest);
        let [a, b] = [own, next].map(|c| beyond_span(&span, &jacobian.column(c).into_owned()));
        next += 1;
        let norms = a.norm() * b.norm();
        if norms > 0.0 { (a.dot(&b) / norms).abs() } else { 0.0 }
    };
    Ok(swaps.iter().enumerate().map(&mut of).collect())
}

/// What is left of `vector` outside the span of the columns.
pub(crate) fn beyond_span(columns: &DMatrix<f64>, vector: &DVector<f64>) -> DVector<f64> {
    if columns.ncols() == 0 {
        return vector.clone();
    }
    let svd = columns.clone().svd(true, false);
    let Some(u) = svd.u else { return vector.clone() };
    let least = 1e-9 * svd.singular_values.max();
    let mut left = vector.clone();
    for (i, s) in svd.singular_values.iter().enumerate() {
        if *s > least {
            let direction = u.column(i);
            left -= direction * direction.dot(vector);
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_in_the_span_is_taken_out() {
        let columns = DMatrix::from_column_slice(3, 2, &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let left = beyond_span(&columns, &DVector::from_vec(vec![3.0, 4.0, 5.0]));
        assert!((left - DVector::from_vec(vec![0.0, 4.0, 5.0])).norm() < 1e-12);
    }
}
