//! Fits of many data sets that were simulated near one: they borrow its derivatives.

use super::step::{predicted_decrease, stepped};
use super::{Fit, OnRound, Problem, Start};
use crate::error::FinderError;
use catenary_core::Track;

/// A fit that takes another's derivatives ends where a step lowers the sum of squares by less than this. It is one of many,
/// which scatter by some twenty.
const REFIT_DECREASE: f64 = 0.2;
/// Most steps of such a fit.
const REFIT_ROUNDS: usize = 10;
/// Its first damping after a step that found no lower point.
const REFIT_DAMPING: f64 = 0.1;

/// One data set, and what a simulation without noise is at a point near its best fit.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// The point, in unit coordinates.
    pub point: Vec<f64>,
    /// The simulated tracks, one an episode.
    pub tracks: Vec<Track>,
    /// What was measured, a track an episode.
    pub measured: Vec<Track>,
}

impl Fit {
    /// Mends these derivatives by how the simulated values changed on the way to `at`, and goes there if its cost is less;
    /// whether it is.
    fn take_step(&mut self, at: Self) -> bool {
        let moved = self.way_to(&at.point);
        let changed = &self.residuals - &at.residuals;
        let missed = changed - &self.jacobian * &moved;
        self.jacobian += missed * moved.transpose() / moved.norm_squared();
        let is_less = at.cost < self.cost;
        if is_less {
            *self = Self { jacobian: std::mem::take(&mut self.jacobian), ..at };
        }
        is_less
    }
}

impl Problem<'_> {
    /// The least cost of each data set that was simulated near `about`, without derivatives of its own: those of `about`,
    /// mended by what each step shows (Broyden 1965), lead to within [`REFIT_DECREASE`] of it; a data set that they do not lead
    /// there is fitted from where it is. None stands for one that could not be fitted.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn refit(
        &self,
        about: &Fit,
        sets: Vec<Simulated>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<Fit>>, FinderError> {
        let first = |set: &Simulated| self.seen_as(about, &set.point, &set.measured, set.tracks.clone());
        let mut fits: Vec<Option<Fit>> = sets.iter().map(first).collect();
        let mut dampings = vec![0.0; sets.len()];
        let mut going: Vec<usize> = (0..sets.len()).filter(|&i| fits[i].is_some()).collect();
        let mut lost: Vec<usize> = Vec::new();
        for _ in 0..REFIT_ROUNDS {
            let promising = |&i: &usize| {
                let fit = fits[i].as_ref()?;
                let trial = stepped(fit, dampings[i]);
                (predicted_decrease(fit, &trial) > REFIT_DECREASE).then_some((i, trial))
            };
            let trials: Vec<Vec<f64>>;
            (going, trials) = going.iter().filter_map(promising).unzip();
            if going.is_empty() {
                break;
            }
            let answers = self.tracks_each(&trials);
            for ((&i, point), tracks) in going.iter().zip(&trials).zip(answers) {
                let at = tracks.ok().and_then(|tracks| self.seen_as(about, point, &sets[i].measured, tracks));
                match fits[i].as_mut().zip(at).map(|(fit, at)| fit.take_step(at)) {
                    Some(true) => dampings[i] *= 0.1,
                    Some(false) => dampings[i] = f64::max(REFIT_DAMPING, 10.0 * dampings[i]),
                    None => lost.push(i),
                }
            }
            going.retain(|i| !lost.contains(i));
            if on_round().is_break() {
                return Err(FinderError::Cancelled("fit"));
            }
        }
        lost.extend(going);
        if lost.is_empty() {
            return Ok(fits);
        }
        let mut start = |&i: &usize| Some(Start { point: fits[i].take()?.point, tracks: sets[i].measured.clone() });
        let starts = lost.iter().filter_map(&mut start).collect();
        let own = Problem { unknowns: self.unknowns.clone(), decrease: REFIT_DECREASE, ..*self };
        match own.fit(starts, on_round) {
            Ok(found) => lost.into_iter().zip(found).for_each(|(i, fit)| fits[i] = fit),
            Err(FinderError::NoFit(_)) if fits.iter().any(Option::is_some) => (),
            Err(other) => return Err(other),
        }
        Ok(fits)
    }

    /// What simulated tracks say of their point, with the derivatives that those of `about` are; none where they are of no use.
    fn seen_as(&self, about: &Fit, point: &[f64], measured: &[Track], tracks: Vec<Track>) -> Option<Fit> {
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
    fn borrowed_derivatives_lead_to_the_same_least_cost() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let mut go_on = || ControlFlow::Continue(());
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let about = problem.fit(vec![start], &mut go_on).unwrap().remove(0).unwrap();
        let mut rng = seed::rng(12, 0);
        // Points as far off as some standard deviations of the fit, and some so far that the derivatives are of no use.
        for reach in [0.02, 0.6] {
            let sets: Vec<Simulated> = (0..40)
                .map(|_| {
                    let off = || reach * (rng.random::<f64>() - 0.5);
                    let point: Vec<f64> = std::iter::repeat_with(off).zip(&about.point).map(|(o, u)| u + o).collect();
                    let tracks = problem.tracks(&[&point]).unwrap().remove(0);
                    let measured = vec![cases[0].measure(&tracks[0], &mut rng)];
                    Simulated { point, tracks, measured }
                })
                .collect();
            let start = |s: &Simulated| Start { point: s.point.clone(), tracks: s.measured.clone() };
            let exact = problem.fit(sets.iter().map(start).collect(), &mut go_on).unwrap();
            let quick = problem.refit(&about, sets, &mut go_on).unwrap();
            for (exact, quick) in exact.into_iter().zip(quick) {
                let off = quick.unwrap().cost - exact.unwrap().cost;
                assert!(off.abs() < 5.0 * REFIT_DECREASE, "{reach}: {off}");
            }
        }
    }
}
