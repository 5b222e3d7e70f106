//! Fits of many data sets that were simulated near one fit, with its derivatives.

use super::problem::{Fit, OnRound, Problem, Start};
use super::step::{damped_point, predicted_decrease};
use crate::error::FitError;
use catenary_core::Track;

/// Decrease of the cost under which a refit ends. Its residual energy scatters by about twenty between null sets.
const REFIT_DECREASE: f64 = 0.2;
/// Most steps of a refit.
const REFIT_ROUNDS: usize = 10;
/// Damping after the first step of a refit that found no lower point.
const REFIT_DAMPING: f64 = 0.1;

/// Simulated data set, with the point and the noise-free tracks behind it.
#[derive(Debug, Clone)]
pub struct SimulatedSet {
    /// Point in unit coordinates.
    pub point: Vec<f64>,
    /// Simulated tracks without noise, one an episode.
    pub tracks: Vec<Track>,
    /// Simulated measurements with noise, one track an episode.
    pub measured: Vec<Track>,
}

impl Fit {
    /// Updates the Jacobian by the observed change of the simulated values (Broyden 1965), and moves to `at` if its
    /// cost is lower. Returns whether it moved.
    fn broyden_step(&mut self, at: Self) -> bool {
        let moved = self.step_to(&at.point);
        let changed = &self.residuals - &at.residuals;
        let missed = changed - &self.jacobian * &moved;
        // Rank-one update: the new Jacobian explains the observed change exactly.
        self.jacobian += missed * moved.transpose() / moved.norm_squared();
        let is_less = at.cost < self.cost;
        if is_less {
            *self = Self { jacobian: std::mem::take(&mut self.jacobian), ..at };
        }
        is_less
    }
}

impl Problem<'_> {
    /// Best fits of data sets simulated near `about`, without derivatives of their own. The Jacobian of `about`,
    /// updated by each step (Broyden 1965), leads to within 0.2 of the lowest cost. A data set that it
    /// does not lead there is fitted with derivatives. None for a data set that cannot be fitted.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn refit(
        &self,
        about: &Fit,
        sets: Vec<SimulatedSet>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<Fit>>, FitError> {
        let first = |set: &SimulatedSet| self.with_jacobian_of(about, &set.point, &set.measured, set.tracks.clone());
        let mut fits: Vec<Option<Fit>> = sets.iter().map(first).collect();
        // Full Gauss-Newton steps first: each data set was simulated near its best fit.
        let mut dampings = vec![0.0; sets.len()];
        let mut going: Vec<usize> = (0..sets.len()).filter(|&i| fits[i].is_some()).collect();
        let mut lost: Vec<usize> = Vec::new();
        for _ in 0..REFIT_ROUNDS {
            let promising = |&i: &usize| {
                let fit = fits[i].as_ref()?;
                let trial = damped_point(fit, dampings[i]);
                (predicted_decrease(fit, &trial) > REFIT_DECREASE).then_some((i, trial))
            };
            let trials: Vec<Vec<f64>>;
            (going, trials) = going.iter().filter_map(promising).unzip();
            if going.is_empty() {
                break;
            }
            let answers = self.tracks_each(&trials);
            for ((&i, point), tracks) in going.iter().zip(&trials).zip(answers) {
                let at = tracks.ok().and_then(|tracks| self.with_jacobian_of(about, point, &sets[i].measured, tracks));
                match fits[i].as_mut().zip(at).map(|(fit, at)| fit.broyden_step(at)) {
                    Some(true) => dampings[i] *= 0.1,
                    Some(false) => dampings[i] = f64::max(REFIT_DAMPING, 10.0 * dampings[i]),
                    None => lost.push(i),
                }
            }
            going.retain(|i| !lost.contains(i));
            if on_round().is_break() {
                return Err(FitError::Cancelled);
            }
        }
        // Fits without an end after the last round continue with derivatives.
        lost.extend(going);
        if lost.is_empty() {
            return Ok(fits);
        }
        let mut start = |&i: &usize| Some(Start { point: fits[i].take()?.point, tracks: sets[i].measured.clone() });
        let starts = lost.iter().filter_map(&mut start).collect();
        let own = Problem { unknowns: self.unknowns.clone(), decrease: REFIT_DECREASE, ..*self };
        match own.fit(starts, on_round) {
            Ok(found) => lost.into_iter().zip(found).for_each(|(i, fit)| fits[i] = fit),
            Err(FitError::NoFit(_)) if fits.iter().any(Option::is_some) => (),
            Err(other) => return Err(other),
        }
        Ok(fits)
    }

    /// Linearisation of simulated tracks with the Jacobian of `about`; none if the tracks are of no use.
    fn with_jacobian_of(&self, about: &Fit, point: &[f64], measured: &[Track], tracks: Vec<Track>) -> Option<Fit> {
        let is_whole = tracks.iter().all(|t| !t.frames.is_empty());
        let residuals = is_whole.then(|| self.residuals(point, measured, &tracks))?;
        let cost = residuals.norm_squared();
        let jacobian = about.jacobian.clone();
        cost.is_finite().then(|| Fit { point: point.to_vec(), cost, residuals, jacobian, tracks })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};
    use catenary_core::seed;
    use rand::RngExt;
    use std::ops::ControlFlow;

    #[test]
    fn borrowed_derivatives_reach_the_lowest_cost() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        let mut go_on = || ControlFlow::Continue(());
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let about = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
        let mut rng = seed::rng(12, 0);
        // Points within some standard deviations of the fit, and points so far that the borrowed derivatives fail.
        for reach in [0.02, 0.6] {
            let sets: Vec<SimulatedSet> = (0..40)
                .map(|_| {
                    let off = || reach * (rng.random::<f64>() - 0.5);
                    let point: Vec<f64> = std::iter::repeat_with(off).zip(&about.point).map(|(o, u)| u + o).collect();
                    let tracks = problem.tracks(&[&point]).unwrap().remove(0);
                    let measured = vec![episodes[0].measure(&tracks[0], &mut rng)];
                    SimulatedSet { point, tracks, measured }
                })
                .collect();
            let start = |s: &SimulatedSet| Start { point: s.point.clone(), tracks: s.measured.clone() };
            let exact = problem.fit(sets.iter().map(start).collect(), &mut go_on).unwrap();
            let quick = problem.refit(&about, sets, &mut go_on).unwrap();
            for (exact, quick) in exact.into_iter().zip(quick) {
                let off = quick.unwrap().cost - exact.unwrap().cost;
                assert!(off.abs() < 5.0 * REFIT_DECREASE, "{reach}: {off}");
            }
        }
    }
}
