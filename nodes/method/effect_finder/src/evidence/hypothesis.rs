//! Candidate models: the present model with further effects, fitted.

use super::magnitude::{CompanionValue, Magnitude};
use super::marginal::{Evidence, Quadratic, companions_of, sd_of};
use catenary_core::statistics::Z_90;
use std::sync::Arc;
use track_fit::data::{Candidate, Companion, MeasuredEpisode, Unknowns};
use track_fit::fitting::{FidelityCorrection, Fit, Laplace, Problem, is_bound_active};

/// Effort behind a best fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Minimum of the linearised model at the starts of the fit.
    Linearised,
    /// Fit from the most promising starts.
    Fitted,
    /// Fit from some draws of the priors, too.
    Sampled,
    /// Fit from the whole search range.
    Searched,
}

/// Fitted candidate model.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// Effects in the order in which they were added; empty: the present model.
    pub candidates: Vec<Candidate>,
    /// Unknowns of the model. The effects are the last ones; their companions come before them.
    pub unknowns: Unknowns,
    /// Fitted episodes with the fidelity correction of the fit; none: the episodes of the search, corrected for the
    /// present model.
    pub episodes: Option<Arc<[MeasuredEpisode]>>,
    /// State of the model's own fidelity correction.
    pub correction: FidelityCorrection,
    /// Best fit.
    pub fit: Fit,
    /// Evidence over the present model.
    pub evidence: Evidence,
    /// Effort behind the best fit.
    pub effort: Effort,
    /// Standard deviation between conditions of each coordinate of a point; empty if unknown.
    pub spread: Vec<f64>,
}

impl Hypothesis {
    /// Names of the effects.
    pub fn names(&self) -> Vec<&str> {
        self.candidates.iter().map(|c| c.name.as_str()).collect()
    }

    /// Returns whether the model has exactly these effects.
    pub fn is_same(&self, candidates: &[Candidate]) -> bool {
        self.candidates.len() == candidates.len() && candidates.iter().all(|c| self.has(&c.name))
    }

    /// Returns whether the model has the named effect.
    pub fn has(&self, name: &str) -> bool {
        self.candidates.iter().any(|c| c.name == name)
    }

    /// Returns whether the model has some of the effects of `other`, or none, and nothing else.
    pub fn is_part_of(&self, other: &Self) -> bool {
        self.candidates.len() < other.candidates.len() && self.candidates.iter().all(|c| other.has(&c.name))
    }

    /// Column of effect `i` in a point.
    pub fn column(&self, i: usize) -> usize {
        self.unknowns.columns() - self.candidates.len() + i
    }

    /// Columns of effect `i` and of its companions in a point.
    pub fn group_columns(&self, i: usize) -> Vec<usize> {
        let companions = self.unknowns.companions_of(&self.candidates[i].name);
        companions.into_iter().chain([self.column(i)]).collect()
    }

    /// Value and standard deviation of effect `i`, all other unknowns free, with its spread between conditions.
    pub fn magnitude(&self, i: usize) -> (f64, f64) {
        let candidate = &self.candidates[i];
        let cost = Quadratic::of(&self.fit, &self.candidates);
        let (low, high) = candidate.search().bounds();
        // Data without information leave the value uniform over the search range.
        let most = (high - low) / 12f64.sqrt();
        let own = cost.map_or(most, |c| sd_of(candidate, &c, i).min(most));
        let value = candidate.search().from_unit(self.fit.point[self.column(i)]);
        // The spread between conditions is independent of the fit's own uncertainty.
        (value, own.hypot((high - low) * self.spread.get(self.column(i)).copied().unwrap_or(0.0)))
    }

    /// Effects with their values and standard deviations.
    pub fn magnitudes(&self) -> Vec<Magnitude> {
        let one = |(i, candidate): (usize, &Candidate)| {
            let (value, sd) = self.magnitude(i);
            let companions = self.companions(candidate);
            Magnitude { name: candidate.name.clone(), title: candidate.title.clone(), value, sd, companions }
        };
        self.candidates.iter().enumerate().map(one).collect()
    }

    /// Companions of an effect with their values and intervals, all other unknowns free.
    fn companions(&self, candidate: &Candidate) -> Vec<CompanionValue> {
        if candidate.companions.is_empty() {
            return Vec::new();
        }
        let posterior = self.posterior();
        let columns = self.unknowns.companions_of(&candidate.name);
        let one = |(companion, column): (&Companion, usize)| {
            let u = self.fit.point[column];
            // Data without a posterior leave the whole prior.
            let reach = posterior.as_ref().map_or(1.0, |p| Z_90 * p.sd(column));
            let at = |u: f64| companion.prior.from_unit(u.clamp(0.0, 1.0));
            let (name, title) = (companion.name.clone(), companion.title.clone());
            CompanionValue { name, title, value: at(u), q05: at(u - reach), q95: at(u + reach) }
        };
        candidate.companions.iter().zip(columns).map(one).collect()
    }

    /// Effect that stands in for something else, and the value that it would need: it is at the
    /// [limit](Candidate::limit_at) of its range and would fit better beyond it, or its 90 % interval lies outside of its prior.
    pub fn stand_in(&self) -> Option<(&Candidate, f64)> {
        let gradient = self.fit.gradient();
        self.candidates.iter().enumerate().find_map(|(i, candidate)| {
            let column = self.column(i);
            let u = self.fit.point[column];
            let limit = candidate.limit_at(u).filter(|_| is_bound_active(u, gradient[column]));
            let beyond = || {
                let ((value, sd), [low, high]) = (self.magnitude(i), candidate.support());
                let reach = Z_90 * sd;
                (value - reach > high || value + reach < low).then_some(value)
            };
            limit.or_else(beyond).map(|value| (candidate, value))
        })
    }

    /// Pairs of effects, by index, of which the data determine little more than a sum or a difference: the correlation of
    /// their sizes is at least `least`, all other unknowns free.
    pub fn trading_pairs(&self, least: f64) -> Vec<(usize, usize)> {
        let companions = companions_of(&self.candidates, self.unknowns.columns());
        let Some(likelihood) = Laplace::of_likelihood(&self.fit, companions) else { return Vec::new() };
        let correlations = likelihood.correlations(self.column(0)..self.unknowns.columns());
        let pairs = (0..self.candidates.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
        pairs.filter(|&pair| correlations[pair].abs() >= least).collect()
    }

    /// Starting points for a fit of this model near the fit of `other`. Shared unknowns start as in `other`. Each
    /// effect that `other` lacks starts in turn at its own starting values, and finally at its present value, always with its
    /// present companions. The present fit may lie in another local minimum.
    pub fn starts_near(&self, other: &Hypothesis) -> Vec<Vec<f64>> {
        let there = self.unknowns.point_from(&other.unknowns, &other.fit.point);
        let own = |i: &usize| !other.has(&self.candidates[*i].name);
        let mut current = there;
        for i in (0..self.candidates.len()).filter(own) {
            for column in self.group_columns(i) {
                current[column] = self.fit.point[column];
            }
        }
        let moved = |i: usize| {
            let (column, candidate, current) = (self.column(i), &self.candidates[i], &current);
            candidate.starts().into_iter().map(move |value| {
                let mut point = current.clone();
                point[column] = candidate.search().to_unit(value).clamp(0.0, 1.0);
                point
            })
        };
        let mut points: Vec<Vec<f64>> = (0..self.candidates.len()).filter(own).flat_map(moved).collect();
        points.push(current);
        points
    }

    /// Posterior of the unknowns around the fit, with their spread between conditions; none if the Gauss-Newton matrix is not
    /// positive definite.
    pub fn posterior(&self) -> Option<Laplace> {
        Some(Laplace::of(&self.fit)?.widened(0, &self.spread))
    }

    /// Fitting problem of the model.
    pub fn problem<'a>(&'a self, problem: &Problem<'a>) -> Problem<'a> {
        problem_with(problem, &self.unknowns, self.episodes.as_deref())
    }
}

/// Problem with these unknowns, and with `episodes` if there are any.
pub(super) fn problem_with<'a>(
    problem: &Problem<'a>,
    unknowns: &Unknowns,
    episodes: Option<&'a [MeasuredEpisode]>,
) -> Problem<'a> {
    Problem { unknowns: unknowns.clone(), episodes: episodes.unwrap_or(problem.episodes), ..*problem }
}

/// Lowest cost of the fitted models.
pub fn lowest_cost(all: &[Hypothesis]) -> f64 {
    all.iter().filter(|h| h.effort != Effort::Linearised).map(|h| h.fit.cost).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::Prior;
    use nalgebra::{DMatrix, DVector};
    use std::ops::ControlFlow;
    use track_fit::fitting::Start;
    use track_fit::toy::{self, Toy, candidate};

    /// Model with one effect, fitted from one start to data with a tip mass of 0.05.
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
            episodes: None,
            correction: FidelityCorrection::Untried,
            fit,
            evidence,
            effort: Effort::Fitted,
            spread: Vec::new(),
        }
    }

    #[test]
    fn starts_near_another_fit_take_its_theta_and_all_values_of_the_own_effect() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let (other, own) = (fitted(&problem, "tip_mass_kg", 0.5), fitted(&problem, "linear_drag_n_s_m2", 0.4));
        let points = own.starts_near(&other);
        assert_eq!(points.len(), own.candidates[0].starts().len() + 1);
        for point in &points {
            let pairs = point[..2].iter().zip(&other.fit.point);
            assert!(pairs.fold(0.0, |most: f64, (a, b)| most.max((a - b).abs())) < 1e-9, "{point:?}");
        }
        assert_ne!(own.fit.point[..2], other.fit.point[..2], "the wrong effect bends theta");
        let search = own.candidates[0].search();
        let mut values: Vec<f64> = points.iter().map(|p| search.from_unit(p[2])).collect();
        let last = values.pop().unwrap();
        assert!((last - own.magnitude(0).0).abs() < 1e-9);
        assert!(values.iter().zip(own.candidates[0].starts()).all(|(a, b)| (a - b).abs() < 1e-9), "{values:?}");
        // The other model has the effect, too, so that its value there is used.
        let [point] = own.starts_near(&own).try_into().unwrap();
        assert!(point.iter().zip(&own.fit.point).all(|(a, b)| (a - b).abs() < 1e-9), "{point:?}");
    }

    /// Group of an effect and a companion, fitted.
    fn group(jacobian: DMatrix<f64>) -> Hypothesis {
        let model = toy::model();
        let prior = Prior::LogUniform { low: 1.0, high: 100.0 };
        let companion = Companion { name: "place".into(), title: "place".into(), prior };
        let group = Candidate { companions: vec![companion], ..candidate("tip_mass_kg") };
        let candidates = vec![group, candidate("linear_drag_n_s_m2")];
        let unknowns = candidates.iter().fold(Unknowns::of(&model, 1), |u, c| u.with(c));
        let residuals = DVector::zeros(jacobian.nrows());
        let fit = Fit { point: vec![0.5; unknowns.columns()], cost: 0.0, residuals, jacobian, tracks: Vec::new() };
        Hypothesis {
            candidates,
            unknowns,
            episodes: None,
            correction: FidelityCorrection::Untried,
            fit,
            evidence: Evidence { alone: 0.0, with: Vec::new() },
            effort: Effort::Fitted,
            spread: Vec::new(),
        }
    }

    #[test]
    fn each_number_of_a_group_has_an_interval_within_its_prior() {
        // Columns: two parameters, the companion, both effects.
        let mut jacobian: DMatrix<f64> = 100.0 * DMatrix::identity(5, 5);
        let known = group(jacobian.clone());
        assert_eq!((known.column(0), known.group_columns(0), known.group_columns(1)), (3, vec![2, 3], vec![4]));
        let [mass, drag] = known.magnitudes().try_into().unwrap();
        assert!(drag.companions.is_empty() && mass.companions.len() == 1);
        // The coordinate is a half of the logarithm of base 10.
        let factor = 100f64.powf(Z_90 / 10_012f64.sqrt());
        let place = &mass.companions[0];
        let off = [(place.value, 10.0), (place.q05, 10.0 / factor), (place.q95, 10.0 * factor)];
        assert!(off.iter().all(|(got, expected)| (got / expected - 1.0).abs() < 1e-9), "{place:?}");
        jacobian[(2, 2)] = 0.0;
        let unknown = group(jacobian).magnitudes().remove(0).companions.remove(0);
        assert!(unknown.q05 >= 1.0 && unknown.q95 <= 100.0 && unknown.q95 / unknown.q05 > 50.0, "{unknown:?}");
    }

    #[test]
    fn a_companion_that_goes_with_its_effect_is_no_trading_pair() {
        let mut jacobian: DMatrix<f64> = 100.0 * DMatrix::identity(5, 5);
        (jacobian[(3, 2)], jacobian[(2, 2)]) = (1000.0, 1.0);
        let one = group(jacobian.clone());
        assert!(one.trading_pairs(0.9).is_empty());
        (jacobian[(4, 3)], jacobian[(4, 4)], jacobian[(3, 2)], jacobian[(3, 3)]) = (1000.0, 1000.0, 0.0, 1.0);
        assert_eq!(group(jacobian).trading_pairs(0.9), [(0, 1)]);
    }

    #[test]
    fn an_effect_at_its_limit_stands_in_if_it_would_fit_better_beyond() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[("tip_mass_kg", 0.05)])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let mut there = fitted(&problem, "tip_mass_kg", 0.5);
        there.candidates[0].range = [0.0, 0.3];
        assert!(there.stand_in().is_none(), "it lies within");
        let column = there.column(0);
        there.fit.point[column] = 1.0;
        let mut found = |towards: f64| {
            there.fit.residuals = towards * there.fit.jacobian.column(column).into_owned();
            there.stand_in().map(|(_, limit)| limit)
        };
        // The prior ends at 0.1, so that a well-known value at 0.3 is beyond it wherever the cost falls.
        assert_eq!([1.0, -1.0].map(&mut found).map(|v| v.is_some_and(|v| (v - 0.3).abs() < 1e-12)), [true; 2]);
        // A value of which the data say nothing may lie within a prior up to 0.2.
        there.candidates[0].prior = Prior::LogUniform { low: 1e-3, high: 0.2 };
        there.fit.jacobian *= 1e-6;
        let mut found = |towards: f64| {
            there.fit.residuals = towards * there.fit.jacobian.column(column).into_owned();
            there.stand_in().is_some()
        };
        assert_eq!([1.0, -1.0].map(&mut found), [true, false]);
    }

    #[test]
    fn an_undetermined_effect_has_the_spread_of_its_search_range() {
        let toy = Toy { gain: 1e-9 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let (_, sd) = fitted(&problem, "tip_mass_kg", 0.5).magnitude(0);
        // The search range is three times the prior.
        assert!((sd - 0.3 / 12f64.sqrt()).abs() < 1e-9, "{sd}");
    }
}
