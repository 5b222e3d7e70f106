//! Which effect explains the disagreement: each candidate is fitted beside the parameters, and its evidence compared.
//!
//! The marginal likelihood of a candidate over the present model's, after Laplace: along the candidate's magnitude the cost
//! of the best fit is taken as a parabola, and weighed with the prior of the magnitude; the volumes of the other directions
//! are alike in both and cancel.

use crate::candidate::Candidate;
use crate::error::FinderError;
use crate::fit::{Fit, OnRound, Problem, Seen, Start, presses};
use crate::laplace::Laplace;
use crate::settings::Settings;
use crate::unknowns::Unknowns;
use catenary_core::Prior;
use catenary_core::mixture::log_sum_exp;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Points of the quadrature over a magnitude, by quantiles of its prior and about its best value.
const NODES: usize = 800;
/// Reach of the nodes about the best value, in standard deviations.
const REACH: f64 = 8.0;

/// How many times as far behind an effect may be that changes the same as the best one: what tells them apart then is as
/// likely an error of the noise's model.
const ALIKE: f64 = 3.0;

/// What a candidate explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Name of the effect, with its unit.
    pub name: String,
    /// Its name in a sentence.
    pub title: String,
    /// Its value at the best fit, in its unit.
    pub value: f64,
    /// Standard deviation of it, parameters free.
    pub sd: f64,
    /// Sum of the squared residuals with it.
    pub statistic: f64,
    /// Logarithm of the evidence with it over the evidence without.
    pub log_bayes_factor: f64,
    /// Posterior probability among all candidates and none, where all are as likely beforehand as none.
    pub probability: f64,
    /// Cosine between what it changes and what the best one changes, beyond what parameters can change.
    pub cosine_with_best: f64,
}

/// A candidate that was fitted.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The candidate.
    pub candidate: Candidate,
    /// The unknowns with it.
    pub unknowns: Unknowns,
    /// Its best fit.
    pub fit: Fit,
    /// What it explains.
    pub explanation: Explanation,
}

/// Fits `candidate` beside the unknowns of `problem`, whose own best fit is `base`.
///
/// # Errors
/// [`FinderError::NoFit`] where the model has nothing for the effect to act on, or it changes nothing in these data: an
/// effect that acts at random does not, as fits are without noise.
pub fn try_candidate(
    problem: &Problem<'_>,
    base: &Fit,
    candidate: &Candidate,
    on_round: OnRound<'_>,
) -> Result<Fitted, FinderError> {
    let unknowns = problem.unknowns.with(candidate);
    let with = Problem { unknowns: unknowns.clone(), ..*problem };
    let column = unknowns.columns() - 1;
    let search = candidate.search();
    let from = |value: f64| {
        let mut point = unknowns.point_from(&problem.unknowns, &base.point);
        point[column] = search.to_unit(value).clamp(0.0, 1.0);
        Start { point, tracks: problem.measured() }
    };
    let starts: Vec<Start> = std::iter::once(candidate.base).chain(candidate.starts()).map(from).collect();
    let seen: Vec<Seen> = with.look(starts, on_round)?.into_iter().flatten().collect();
    if seen.iter().all(|seen| seen.fit.jacobian.column(column).iter().all(|v| *v == 0.0)) {
        return Err(FinderError::NoFit(format!("{} changes nothing that was measured", candidate.title)));
    }
    let fits = with.climb(seen, on_round)?;
    let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
    let fit = best.ok_or_else(|| FinderError::NoFit("no start was left".into()))?;
    let laplace =
        Laplace::of_likelihood(&fit).ok_or_else(|| FinderError::NoFit("the curvature is no positive matrix".into()))?;
    let parabola = Parabola::of(&fit, &laplace, column);
    let (low, high) = search.bounds();
    let explanation = Explanation {
        name: candidate.name.clone(),
        title: candidate.title.clone(),
        value: search.from_unit(fit.point[column]),
        sd: parabola.sd * (high - low),
        statistic: fit.cost,
        log_bayes_factor: log_bayes_factor(candidate, &search, &parabola, base.cost),
        probability: 0.0,
        cosine_with_best: 0.0,
    };
    Ok(Fitted { candidate: candidate.clone(), unknowns, fit, explanation })
}

/// The cost of the best fit along one coordinate: cost + 2 slope (u - at) + ((u - at) / sd)^2.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    at: f64,
    cost: f64,
    slope: f64,
    sd: f64,
}

impl Parabola {
    fn of(fit: &Fit, laplace: &Laplace, column: usize) -> Self {
        let (at, gradient) = (fit.point[column], fit.gradient()[column]);
        let slope = if presses(at, gradient) { gradient } else { 0.0 };
        Self { at, cost: fit.cost, slope, sd: laplace.sd(column) }
    }

    fn cost(&self, u: f64) -> f64 {
        let d = u - self.at;
        self.cost + 2.0 * self.slope * d + (d / self.sd).powi(2)
    }

    /// Where the parabola is least.
    fn least(&self) -> f64 {
        self.at - self.slope * self.sd * self.sd
    }
}

/// Logarithm of the integral of prior times likelihood over the magnitude, over the likelihood at a cost of `base`.
fn log_bayes_factor(candidate: &Candidate, search: &Prior, parabola: &Parabola, base: f64) -> f64 {
    let (low, high) = candidate.prior.bounds();
    let side = |sign: &f64| {
        let ends = [low, high].map(|v| candidate.base + sign * v);
        let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let quantile = |i: usize| candidate.base + sign * candidate.prior.from_unit((i as f64 + 0.5) / NODES as f64);
        let about = |i: usize| {
            let z = REACH * (2.0 * i as f64 / NODES as f64 - 1.0);
            search.from_unit(parabola.least() + z * parabola.sd)
        };
        let mut values: Vec<f64> = (0..NODES).map(quantile).chain((0..=NODES).map(about)).chain(ends).collect();
        values.retain(|v| (from..=to).contains(v) && candidate.density(*v) > 0.0);
        values.sort_by(f64::total_cmp);
        let log_weight = |v: &f64| candidate.density(*v).ln() - 0.5 * (parabola.cost(search.to_unit(*v)) - base);
        log_area(&values, &values.iter().map(log_weight).collect::<Vec<f64>>())
    };
    let sides: Vec<f64> = candidate.signs().iter().map(side).collect();
    log_sum_exp(&sides)
}

/// Logarithm of the area under a curve whose logarithms are given at increasing places, by trapezoids.
fn log_area(places: &[f64], logs: &[f64]) -> f64 {
    let greatest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !greatest.is_finite() || places.len() < 2 {
        return f64::NEG_INFINITY;
    }
    let height = |i: usize| (logs[i] - greatest).exp();
    let area = |i: usize| 0.5 * (height(i) + height(i + 1)) * (places[i + 1] - places[i]);
    greatest + (0..places.len() - 1).map(area).sum::<f64>().ln()
}

/// Puts candidates in order of their evidence, with probabilities and with cosines to the best one.
///
/// Returns them, and the probability of none.
///
/// # Errors
/// [`FinderError`] of the simulator.
pub fn rank(problem: &Problem<'_>, mut fitted: Vec<Fitted>) -> Result<(Vec<Fitted>, f64), FinderError> {
    fitted.sort_by(|a, b| b.explanation.log_bayes_factor.total_cmp(&a.explanation.log_bayes_factor));
    let Some(best) = fitted.first().cloned() else { return Ok((fitted, 1.0)) };
    let greatest = best.explanation.log_bayes_factor.max(0.0);
    let total: f64 =
        fitted.iter().map(|f| (f.explanation.log_bayes_factor - greatest).exp()).sum::<f64>() + (-greatest).exp();
    let cosines = cosines(problem, &best, &fitted)?;
    for (fitted, cosine) in fitted.iter_mut().zip(cosines) {
        fitted.explanation.probability = (fitted.explanation.log_bayes_factor - greatest).exp() / total;
        fitted.explanation.cosine_with_best = cosine;
    }
    Ok((fitted, (-greatest).exp() / total))
}

/// Cosines, at the best candidate's fit, between what it and what each other candidate changes in the data once the other
/// unknowns have done what they can.
fn cosines(problem: &Problem<'_>, best: &Fitted, fitted: &[Fitted]) -> Result<Vec<f64>, FinderError> {
    let others: Vec<&Fitted> = fitted.iter().filter(|f| f.candidate.name != best.candidate.name).collect();
    // The best one first: `with` appends, so that every candidate has a column of its own at the end.
    let mut unknowns = best.unknowns.clone();
    others.iter().for_each(|f| unknowns = unknowns.with(&f.candidate));
    let mut point = unknowns.point_from(&best.unknowns, &best.fit.point);
    let first = unknowns.columns() - others.len();
    for (i, other) in others.iter().enumerate() {
        point[first + i] = other.candidate.search().to_unit(other.candidate.base).clamp(0.0, 1.0);
    }
    let all = Problem { unknowns, ..*problem };
    let start = Start { point, tracks: problem.measured() };
    let seen = all.look(vec![start], &mut || std::ops::ControlFlow::Continue(()))?;
    let jacobian = seen.into_iter().flatten().next().map(|seen| seen.fit.jacobian);
    let Some(jacobian) = jacobian else { return Ok(vec![0.0; fitted.len()]) };
    let parameters = jacobian.columns(0, first - 1).into_owned();
    let beyond = |column: usize| beyond_span(&parameters, &jacobian.column(column).into_owned());
    let own = beyond(first - 1);
    let cosine = |f: &Fitted| match others.iter().position(|o| o.candidate.name == f.candidate.name) {
        None => 1.0,
        Some(i) => {
            let other = beyond(first + i);
            let norms = own.norm() * other.norm();
            if norms > 0.0 { (own.dot(&other) / norms).abs() } else { 0.0 }
        }
    };
    Ok(fitted.iter().map(cosine).collect())
}

/// What is left of `vector` outside the span of the columns.
fn beyond_span(columns: &DMatrix<f64>, vector: &DVector<f64>) -> DVector<f64> {
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

/// The candidates that the data do not tell from the best: nearly as good, or not far behind and changing the same. The first
/// is the best.
pub fn group<'a>(ranked: &'a [Fitted], settings: &Settings) -> Vec<&'a Fitted> {
    let Some(best) = ranked.first() else { return Vec::new() };
    let is_like = |f: &&Fitted| {
        let behind = best.explanation.log_bayes_factor - f.explanation.log_bayes_factor;
        let explains = f.explanation.log_bayes_factor > 0.0;
        let least = settings.least_log_bayes_factor;
        let is_alike = f.explanation.cosine_with_best > settings.greatest_cosine;
        explains && (behind < least || (is_alike && behind < ALIKE * least))
    };
    ranked.iter().filter(is_like).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(prior: Prior) -> Candidate {
        let range = [if prior.bounds().0 < 0.0 { -10.0 } else { 0.0 }, 10.0];
        Candidate { name: "x".into(), title: "x".into(), prior, range, base: 0.0 }
    }

    /// With a uniform prior much wider than the likelihood, the evidence is sqrt(2 pi) sd / width at the peak.
    #[test]
    fn a_sharp_peak_under_a_flat_prior_gives_the_closed_form() {
        let c = candidate(Prior::Uniform { low: -1.0, high: 1.0 });
        let search = c.search();
        // The search spans 6, so that a standard deviation of 0.02 is 0.02 / 6 of it.
        let parabola = Parabola { at: search.to_unit(0.4), cost: 100.0, slope: 0.0, sd: 0.02 / 6.0 };
        let expected = 0.5 * (140.0 - 100.0) + ((2.0 * std::f64::consts::PI).sqrt() * 0.02 / 2.0).ln();
        let got = log_bayes_factor(&c, &search, &parabola, 140.0);
        assert!((got - expected).abs() < 1e-4, "{got} for {expected}");
    }

    #[test]
    fn an_effect_that_does_nothing_is_as_likely_as_none() {
        let c = candidate(Prior::LogUniform { low: 1e-3, high: 1.0 });
        let parabola = Parabola { at: 0.0, cost: 50.0, slope: 0.0, sd: 1e6 };
        let got = log_bayes_factor(&c, &c.search(), &parabola, 50.0);
        assert!(got.abs() < 1e-3, "{got}");
    }

    #[test]
    fn data_that_speak_against_an_effect_lower_its_evidence() {
        let c = candidate(Prior::LogUniform { low: 1e-3, high: 1.0 });
        // At zero the cost rises with the magnitude.
        let parabola = Parabola { at: 0.0, cost: 50.0, slope: 30.0, sd: 0.01 };
        let got = log_bayes_factor(&c, &c.search(), &parabola, 50.0);
        assert!((-20.0..-0.3).contains(&got), "{got}");
    }

    #[test]
    fn what_lies_in_the_span_is_taken_out() {
        let columns = DMatrix::from_column_slice(3, 2, &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let left = beyond_span(&columns, &DVector::from_vec(vec![3.0, 4.0, 5.0]));
        assert!((left - DVector::from_vec(vec![0.0, 4.0, 5.0])).norm() < 1e-12);
    }
}
