//! Levenberg-Marquardt iterations from many starts, in step.

use super::problem::{Fit, LinearisedStart, OnRound, Problem, Start};
use super::step::{damped_point, predicted_decrease};
use crate::error::FitError;
use catenary_core::Track;
use catenary_core::simulator::SimulatorError;

/// Initial damping, relative to the curvature.
const DAMPING: f64 = 1e-3;
/// Damping at which a fit without a lower point ends.
const GREATEST_DAMPING: f64 = 1e6;
/// Relative decrease under which a fit behind the best other model ends: this share of its lag.
const BEHIND_DECREASE: f64 = 0.01;
/// Rounds after which the worse half of the starts is dropped (successive halving).
const HALVING_ROUNDS: usize = 4;

/// Fit in progress.
struct Descent {
    tracks: Vec<Track>,
    fit: Fit,
    trial: Vec<f64>,
    damping: f64,
    done: bool,
}

impl Problem<'_> {
    /// Fits each data set from its start; none for a start that cannot be simulated.
    ///
    /// # Errors
    /// [`FitError::NoFit`] if none could be, [`FitError::Cancelled`] if `on_round` breaks.
    pub fn fit(&self, starts: Vec<Start>, on_round: OnRound<'_>) -> Result<Vec<Option<Fit>>, FitError> {
        let seen = self.linearise(starts, on_round)?;
        let is_seen: Vec<bool> = seen.iter().map(Option::is_some).collect();
        let mut fits = self.minimise(seen.into_iter().flatten().collect(), on_round)?.into_iter();
        Ok(is_seen.into_iter().map(|is_seen| if is_seen { fits.next() } else { None }).collect())
    }

    /// Best fit of one data set from these starts, by successive halving: every few rounds the worse half is dropped.
    ///
    /// # Errors
    /// As [`Problem::minimise`]; [`FitError::NoFit`] if there is no start.
    pub fn minimise_best(&self, seen: Vec<LinearisedStart>, on_round: OnRound<'_>) -> Result<Fit, FitError> {
        let fits = self.minimise_with(seen, true, on_round)?.into_iter();
        fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).ok_or_else(|| FitError::NoFit("no start was left".into()))
    }

    /// Fits from these starts, in the same order.
    ///
    /// # Errors
    /// [`FitError::Cancelled`] if `on_round` breaks.
    pub fn minimise(&self, seen: Vec<LinearisedStart>, on_round: OnRound<'_>) -> Result<Vec<Fit>, FitError> {
        self.minimise_with(seen, false, on_round)
    }

    /// Levenberg-Marquardt iterations, with or without successive halving.
    fn minimise_with(
        &self,
        seen: Vec<LinearisedStart>,
        is_halving: bool,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Fit>, FitError> {
        let mut descents: Vec<Descent> = seen.into_iter().map(|seen| Descent::new(seen, self)).collect();
        for round in 1..self.rounds {
            if is_halving && round % HALVING_ROUNDS == 0 {
                halve(&mut descents);
            }
            let at: Vec<usize> = (0..descents.len()).filter(|&i| !descents[i].done).collect();
            if at.is_empty() {
                break;
            }
            // Derivatives cost as much as several simulations, so that they are taken only at lower points.
            let trials: Vec<Vec<f64>> = at.iter().map(|&i| descents[i].trial.clone()).collect();
            let is_lower = |(descent, tracks): (&Descent, Result<Vec<Track>, SimulatorError>)| {
                let cost = |t: Vec<Track>| self.residuals(&descent.trial, &descent.tracks, &t).norm_squared();
                tracks.is_ok_and(|t| cost(t) < descent.fit.cost)
            };
            let tracks = self.tracks_each(&trials);
            let lower: Vec<bool> = at.iter().map(|&i| &descents[i]).zip(tracks).map(is_lower).collect();
            let on = at.iter().zip(&lower).filter(|(_, lower)| **lower).map(|(&i, _)| &descents[i]);
            let mut fits =
                self.evaluate(on.map(|c| (c.trial.as_slice(), c.tracks.as_slice())).collect(), None).into_iter();
            for (i, is_lower) in at.into_iter().zip(lower) {
                // `fits` holds the lower trials alone, in order.
                let fit = if is_lower { fits.next() } else { None };
                descents[i].advance(fit.and_then(Result::ok), self);
            }
            if on_round().is_break() {
                return Err(FitError::Cancelled);
            }
        }
        Ok(descents.into_iter().map(|c| c.fit).collect())
    }

    /// Decrease of the cost under which a fit at `cost` ends.
    fn last_decrease(&self, cost: f64) -> f64 {
        self.decrease.max(BEHIND_DECREASE * (cost - self.aim))
    }
}

/// Ends the worse half of the fits in progress, by their cost so far.
fn halve(descents: &mut [Descent]) {
    let mut left: Vec<usize> = (0..descents.len()).filter(|&i| !descents[i].done).collect();
    left.sort_by(|&a, &b| descents[a].fit.cost.total_cmp(&descents[b].fit.cost));
    left.iter().skip(left.len().div_ceil(2)).for_each(|&i| descents[i].done = true);
}

impl Descent {
    fn new(seen: LinearisedStart, problem: &Problem<'_>) -> Self {
        let LinearisedStart { tracks, fit } = seen;
        let mut descent = Self { tracks, trial: fit.point.clone(), fit, damping: DAMPING, done: false };
        descent.choose(problem);
        descent
    }

    /// Accepts or rejects the trial, and chooses the next one.
    fn advance(&mut self, trial: Option<Fit>, problem: &Problem<'_>) {
        match trial {
            Some(new) if new.cost < self.fit.cost => {
                // The constants 0.1 and 10 are Marquardt's (1963).
                self.done = self.fit.cost - new.cost < problem.last_decrease(new.cost);
                self.damping = (self.damping * 0.1).max(1e-9);
                self.fit = new;
            }
            _ => {
                self.damping *= 10.0;
                self.done = self.damping > GREATEST_DAMPING;
            }
        }
        if !self.done {
            self.choose(problem);
        }
    }

    /// Chooses the next trial: a damped step of the free coordinates.
    fn choose(&mut self, problem: &Problem<'_>) {
        self.trial = damped_point(&self.fit, self.damping);
        let predicted = predicted_decrease(&self.fit, &self.trial);
        // A step that promises much less than the stopping rule is not worth a simulation.
        if predicted < 0.1 * problem.last_decrease(self.fit.cost) {
            self.done = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{MeasuredEpisode, Unknowns};
    use crate::fitting::is_bound_active;
    use crate::toy::{self, Toy};
    use catenary_core::seed;
    use nalgebra::{DMatrix, DVector};
    use std::ops::ControlFlow;

    fn fit(episodes: &[MeasuredEpisode], points: &[[f64; 2]]) -> Result<Vec<Option<Fit>>, FitError> {
        let toy = Toy { gain: 0.3 };
        let problem = Problem::of(&toy::model(), episodes, &toy, 40);
        let start = |p: &[f64; 2]| Start { point: p.to_vec(), tracks: problem.measured() };
        problem.fit(points.iter().map(start).collect(), &mut || ControlFlow::Continue(()))
    }

    #[test]
    fn exact_data_are_fitted_exactly_from_any_start() {
        let episodes = [toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
        for fit in fit(&episodes, &[[0.5, 0.5], [0.1, 0.95], [1.0, 0.0]]).unwrap() {
            let fit = fit.unwrap();
            let values = Unknowns::of(&toy::model(), 1).values(&fit.point, 0);
            assert!(
                fit.cost < 0.1 && (values[0] - 0.25).abs() < 1e-3 && (values[1] / 2e4 - 1.0).abs() < 0.02,
                "{values:?}"
            );
        }
    }

    /// The least squares of a linear model leave N - d squared residuals on average.
    #[test]
    fn the_residual_energy_has_the_degrees_of_freedom_of_the_data_less_the_unknowns() {
        let episode = toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        let costs: Vec<f64> = (0..200)
            .map(|i| {
                let noisy = episode.measured_anew(&mut seed::rng(11, i));
                fit(&[noisy], &[[0.5, 0.5]]).unwrap().remove(0).unwrap().cost
            })
            .collect();
        let mean = costs.iter().sum::<f64>() / 200.0;
        let expected = (8 * toy::FRAMES - 2) as f64;
        // Standard deviation of the mean: sqrt(2 N / 200) = 1.3.
        assert!((mean - expected).abs() < 4.0, "{mean} for {expected}");
    }

    #[test]
    fn a_value_beyond_the_prior_has_an_active_bound() {
        let episodes = [toy::episode(&Toy { gain: 0.3 }, [0.35, 2e4], &[])];
        let fit = fit(&episodes, &[[0.5, 0.5]]).unwrap().remove(0).unwrap();
        let is_bound_active = |column: usize| is_bound_active(fit.point[column], fit.gradient()[column]);
        assert!(fit.point[0] == 1.0 && is_bound_active(0) && !is_bound_active(1), "{:?}", fit.point);
    }

    #[test]
    fn a_start_that_cannot_be_simulated_does_not_fail_the_others() {
        let episodes = [toy::episode(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
        let fits = fit(&episodes, &[[0.5, 0.5], [0.0, 0.5]]).unwrap();
        assert!(fits[0].as_ref().is_some_and(|f| f.cost < 0.1) && fits[1].is_none());
        let refusal = fit(&episodes, &[[0.0, 0.5]]).unwrap_err().to_string();
        assert!(refusal.contains("length_m: expected at least 0.2"), "{refusal}");
    }

    #[test]
    fn too_steep_starts_are_refused() {
        let (steep, theta) = (Toy { gain: 1e200 }, [0.25, 2e4]);
        let episodes = [toy::episode(&steep, theta, &[])];
        let problem = Problem::of(&toy::model(), &episodes, &steep, 40);
        let point: Vec<f64> = problem.unknowns.list().iter().zip(theta).map(|(u, v)| u.prior.to_unit(v)).collect();
        let start = Start { point, tracks: problem.measured() };
        let refusal = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap_err().to_string();
        assert!(refusal.contains("not positive definite"), "{refusal}");
    }

    #[test]
    fn a_fit_stops_when_on_round_breaks() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let stopped = problem.fit(vec![start], &mut || ControlFlow::Break(()));
        assert!(matches!(stopped, Err(FitError::Cancelled)));
    }

    #[test]
    fn halving_ends_the_worse_half_and_never_the_best() {
        let fit = |cost| Fit {
            point: vec![0.5],
            cost,
            residuals: DVector::zeros(1),
            jacobian: DMatrix::zeros(1, 1),
            tracks: Vec::new(),
        };
        let descent =
            |cost, done| Descent { tracks: Vec::new(), fit: fit(cost), trial: vec![0.5], damping: DAMPING, done };
        let mut descents = [
            descent(5.0, false),
            descent(1.0, false),
            descent(0.5, true),
            descent(3.0, false),
            descent(f64::NAN, false),
        ];
        let mut heat = || {
            halve(&mut descents);
            descents.each_ref().map(|c| c.done)
        };
        assert_eq!(heat(), [true, false, true, false, true]);
        assert_eq!(heat(), [true, false, true, true, true]);
        assert_eq!(heat(), [true, false, true, true, true], "the last one left has nobody to give up for");
    }
}
