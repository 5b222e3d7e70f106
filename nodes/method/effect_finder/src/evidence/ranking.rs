//! Ranking of candidate models by their posterior probability.

use super::hypothesis::Hypothesis;
use super::magnitude::Magnitude;
use crate::error::FinderError;
use crate::settings::Settings;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use track_fit::FitError;
use track_fit::fitting::{Problem, Start};

/// Factor on the log Bayes factor within which a model that changes the data like the best one is not told from it: a
/// small error of the noise model would decide between them.
const SAME_CHANGE_FACTOR: f64 = 3.0;

/// Explanation of the data by one or several effects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Effects of the model.
    pub effects: Vec<Magnitude>,
    /// Residual energy with the effects.
    pub statistic: f64,
    /// Log Bayes factor of the effects over the present model.
    pub log_bayes_factor: f64,
    /// Probability that these effects are the whole explanation.
    pub probability: f64,
    /// Probability that these effects are present together with a discrepancy.
    pub probability_in_part: f64,
    /// Cosine between the changes of the data by the effect in which this model differs from the best one, and by the
    /// effect in its place there, both orthogonal to the changes of all other unknowns. 1 for the best model, 0 if more
    /// than one effect differs.
    pub cosine_with_best: f64,
}

impl Explanation {
    /// Names of the effects, joined by " + ".
    pub fn names(&self) -> String {
        self.effects.iter().map(|e| e.name.as_str()).collect::<Vec<_>>().join(" + ")
    }
}

/// Candidate models in order of probability.
#[derive(Debug, Clone)]
pub struct Ranking {
    /// Candidate models.
    pub hypotheses: Vec<Hypothesis>,
    /// Explanations by the models, in the same order.
    pub explanations: Vec<Explanation>,
    /// Probability of the present model alone.
    pub none: f64,
    /// Probability of the present model with a discrepancy.
    pub unknown: f64,
}

/// Extent to which effects explain the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// Effects that leave only noise.
    Whole,
    /// Effects that leave a residual.
    Part,
}

/// Log posterior of a model up to a constant, alone and with a discrepancy.
fn logs(h: &Hypothesis, candidates: usize, settings: &Settings) -> [f64; 2] {
    // A further effect shares its prior odds among all candidates.
    let further = (settings.further_effect / candidates.max(1) as f64).ln();
    let odds: f64 = h.candidates.iter().map(|c| c.odds.ln()).sum();
    let prior = odds + further * h.candidates.len().saturating_sub(1) as f64;
    let share = settings.discrepancy_share;
    [h.evidence.alone + (1.0 - share).ln(), h.evidence.with_any() + share.ln()].map(|log| prior + log)
}

/// Log posterior of a model up to a constant, with and without a discrepancy, among a number of `candidates`.
pub fn log_posterior(h: &Hypothesis, candidates: usize, settings: &Settings) -> f64 {
    log_sum_exp(&logs(h, candidates, settings))
}

/// Gain in log posterior of `new` over `old`, two fits of one model, in nats.
pub fn gain(old: &Hypothesis, new: &Hypothesis, settings: &Settings) -> f64 {
    log_posterior(new, 1, settings) - log_posterior(old, 1, settings)
}

impl Ranking {
    /// Lag of model number `place` behind the most probable one, in nats.
    pub fn behind(&self, place: usize) -> f64 {
        let log = |e: &Explanation| (e.probability + e.probability_in_part).ln();
        log(&self.explanations[0]) - log(&self.explanations[place])
    }

    /// Ranks models by posterior probability. The present model and each single effect are equally likely a priori, up
    /// to the candidates' odds; the settings give the priors of further effects and of a discrepancy.
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

    /// Log posterior odds of `one` over `other`, with and without a discrepancy.
    pub fn log_odds(&self, one: &Hypothesis, other: &Hypothesis) -> f64 {
        let log = |wanted: &Hypothesis| {
            let place = self.hypotheses.iter().position(|h| h.is_same(&wanted.candidates));
            let explanation = place.map(|i| &self.explanations[i]);
            explanation.map_or(f64::NEG_INFINITY, |e| (e.probability + e.probability_in_part).ln())
        };
        log(one) - log(other)
    }

    /// Most probable model with effects and its extent; none if the present model is more probable, with or without a
    /// discrepancy.
    pub fn best(&self) -> Option<(&Hypothesis, Extent)> {
        let (hypothesis, explanation) = (self.hypotheses.first()?, self.explanations.first()?);
        let [whole, part] = [explanation.probability, explanation.probability_in_part];
        let extent = if whole >= part { Extent::Whole } else { Extent::Part };
        (whole.max(part) > self.none.max(self.unknown)).then_some((hypothesis, extent))
    }

    /// Models that the data do not tell from the best one: nearly as probable, or not far behind with the same change
    /// of the data. A model with all effects of the best one and more explains no more, and is left out. The best is
    /// the first.
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
            // A model that is less likely than the present one is no alternative.
            let explains = e.log_bayes_factor > 0.0 && !best.is_part_of(h);
            explains
                && (behind < least
                    || (e.cosine_with_best > settings.greatest_cosine && behind < SAME_CHANGE_FACTOR * least))
        };
        let others = self.hypotheses.iter().zip(&self.explanations).skip(1).filter(is_like).map(|(h, _)| h);
        std::iter::once(best).chain(others).collect()
    }
}

/// Groups of effects, one for each effect of the first model: that effect, and its replacements in models that differ
/// in it alone. A model that differs in more effects stands as a whole in the first group.
pub fn groups(alike: &[&Hypothesis]) -> Vec<Vec<String>> {
    let Some((best, others)) = alike.split_first() else { return Vec::new() };
    let mut groups: Vec<Vec<String>> = best.names().into_iter().map(|n| vec![n.to_owned()]).collect();
    for other in others {
        match single_swap(best, other) {
            Some((i, j)) => groups[i].push(other.candidates[j].name.clone()),
            None => groups[0].push(other.names().join(" + ")),
        }
    }
    groups
}

/// Groups of the effects of `best`, with the groups of two effects joined that the data determine only together: they
/// replace, or cancel, each other. Correlations of at least `least` count.
pub fn joined(mut groups: Vec<Vec<String>>, best: &Hypothesis, least: f64) -> Vec<Vec<String>> {
    for (i, j) in best.trading_pairs(least) {
        let of = |groups: &[Vec<String>], name: &str| groups.iter().position(|g| g.iter().any(|n| n == name));
        let places = [i, j].map(|k| of(&groups, &best.candidates[k].name));
        if let [Some(into), Some(from)] = places
            && into != from
        {
            let moved = groups.remove(from);
            groups[if from < into { into - 1 } else { into }].extend(moved);
        }
    }
    groups
}

/// Indices of the one effect of `best` that `other` replaces, and of its replacement; none if they differ in more.
fn single_swap(best: &Hypothesis, other: &Hypothesis) -> Option<(usize, usize)> {
    let missing = |of: &Hypothesis, from: &Hypothesis| -> Vec<usize> {
        (0..of.candidates.len()).filter(|&i| !from.has(&of.candidates[i].name)).collect()
    };
    match (missing(best, other).as_slice(), missing(other, best).as_slice()) {
        ([i], [j]) => Some((*i, *j)),
        _ => None,
    }
}

/// [`Explanation::cosine_with_best`] of each model, at the fit of the best one.
fn cosines(problem: &Problem<'_>, hypotheses: &[Hypothesis]) -> Result<Vec<f64>, FinderError> {
    let Some(best) = hypotheses.first() else { return Ok(Vec::new()) };
    let swaps: Vec<Option<(usize, usize)>> = hypotheses.iter().map(|h| single_swap(best, h)).collect();
    // Column order: the best model's unknowns but for its effects, the companions of the replacement effect of each other model,
    // the best model's effects, then the replacement effects.
    let mut unknowns = best.unknowns.clone();
    let mut others = Vec::new();
    for (h, swap) in hypotheses.iter().zip(&swaps) {
        if let Some((_, j)) = swap {
            unknowns = unknowns.with(&h.candidates[*j]);
            others.push((h, *j));
        }
    }
    let mut point = unknowns.point_from(&best.unknowns, &best.fit.point);
    let first = unknowns.columns() - others.len();
    for (i, (h, j)) in others.iter().enumerate() {
        let other = &h.candidates[*j];
        // At its base a replacement changes nothing yet; its derivative there is compared, with its own companions.
        point[first + i] = other.search().to_unit(other.base).clamp(0.0, 1.0);
        for (column, own) in unknowns.companions_of(&other.name).into_iter().zip(h.unknowns.companions_of(&other.name))
        {
            point[column] = h.fit.point[own];
        }
    }
    let all = Problem { unknowns, ..*problem };
    let start = Start { point, tracks: problem.measured() };
    let nothing = Ok(vec![0.0; hypotheses.len()]);
    let seen = match all.linearise(vec![start], &mut || ControlFlow::Continue(())) {
        // The best fit may be a linearised minimum at which nothing can be simulated.
        Err(FitError::NoFit(_)) => return nothing,
        seen => seen?.into_iter().flatten().next(),
    };
    let Some(seen) = seen else { return nothing };
    let jacobian = seen.fit.jacobian;
    let mut next = first;
    let mut of = |(place, swap): (usize, &Option<(usize, usize)>)| {
        let Some((i, _)) = swap else { return if place == 0 { 1.0 } else { 0.0 } };
        let own = first - best.candidates.len() + i;
        // The companions of the effect change the data with it, not beside it.
        let companions = all.unknowns.companions_of(&best.candidates[*i].name);
        let rest: Vec<usize> = (0..first).filter(|c| *c != own && !companions.contains(c)).collect();
        let span = jacobian.select_columns(&rest);
        let [a, b] = [own, next].map(|c| orthogonal_component(&span, &jacobian.column(c).into_owned()));
        next += 1;
        let norms = a.norm() * b.norm();
        if norms > 0.0 { (a.dot(&b) / norms).abs() } else { 0.0 }
    };
    Ok(swaps.iter().enumerate().map(&mut of).collect())
}

/// Component of `vector` orthogonal to the columns.
fn orthogonal_component(columns: &DMatrix<f64>, vector: &DVector<f64>) -> DVector<f64> {
    if columns.ncols() == 0 {
        return vector.clone();
    }
    let svd = columns.clone().svd(true, false);
    let Some(u) = svd.u else { return vector.clone() };
    // Singular values at rounding level belong to dependent columns.
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
    fn the_component_in_the_span_is_removed() {
        let columns = DMatrix::from_column_slice(3, 2, &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let left = orthogonal_component(&columns, &DVector::from_vec(vec![3.0, 4.0, 5.0]));
        assert!((left - DVector::from_vec(vec![0.0, 4.0, 5.0])).norm() < 1e-12);
    }
}
