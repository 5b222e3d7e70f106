//! Climbs from where fits start to where they end, each by itself or in a race.

use super::step::{predicted_decrease, stepped};
use super::{Fit, OnRound, Problem, Seen};
use crate::error::FinderError;
use catenary_core::Track;
use catenary_core::simulator::SimulatorError;

/// First damping, relative to the curvature.
const DAMPING: f64 = 1e-3;
/// Damping at which a fit that finds no lower point ends.
const GREATEST_DAMPING: f64 = 1e6;
/// A fit that lies above what others came to ends where a step lowers the sum of squares by less than this share of by how much.
const BEHIND_DECREASE: f64 = 0.01;
/// Rounds of a race after which the worse half gives up.
const HEAT: usize = 4;

/// A fit under way.
struct Climb {
    tracks: Vec<Track>,
    fit: Fit,
    trial: Vec<f64>,
    damping: f64,
    done: bool,
}

impl Problem<'_> {
    /// The best of the fits of one data set from all these starts: the worse half of those that are left gives up now and then.
    ///
    /// # Errors
    /// As [`Problem::climb`]; [`FinderError::NoFit`] where there is no start.
    pub fn race(&self, seen: Vec<Seen>, on_round: OnRound<'_>) -> Result<Fit, FinderError> {
        let fits = self.climb_on(seen, true, on_round)?.into_iter();
        fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).ok_or_else(|| FinderError::NoFit("no start was left".into()))
    }

    /// The other rounds of a fit: from each start to the least cost that is found, in the same order.
    ///
    /// # Errors
    /// [`FinderError::Cancelled`] where `on_round` asked to stop.
    pub fn climb(&self, seen: Vec<Seen>, on_round: OnRound<'_>) -> Result<Vec<Fit>, FinderError> {
        self.climb_on(seen, false, on_round)
    }

    /// The same, in a race or each by itself.
    fn climb_on(&self, seen: Vec<Seen>, race: bool, on_round: OnRound<'_>) -> Result<Vec<Fit>, FinderError> {
        let mut climbs: Vec<Climb> = seen.into_iter().map(|seen| Climb::new(seen, self)).collect();
        for round in 1..self.rounds {
            if race && round % HEAT == 0 {
                give_up(&mut climbs);
            }
            let at: Vec<usize> = (0..climbs.len()).filter(|&i| !climbs[i].done).collect();
            if at.is_empty() {
                break;
            }
            // Derivatives cost as much as some simulations: they are taken where one has found a lower point.
            let trials: Vec<Vec<f64>> = at.iter().map(|&i| climbs[i].trial.clone()).collect();
            let is_lower = |(climb, tracks): (&Climb, Result<Vec<Track>, SimulatorError>)| {
                let cost = |t: Vec<Track>| self.residuals(&climb.trial, &climb.tracks, &t).norm_squared();
                tracks.is_ok_and(|t| cost(t) < climb.fit.cost)
            };
            let tracks = self.tracks_each(&trials);
            let lower: Vec<bool> = at.iter().map(|&i| &climbs[i]).zip(tracks).map(is_lower).collect();
            let on = at.iter().zip(&lower).filter(|(_, lower)| **lower).map(|(&i, _)| &climbs[i]);
            let mut fits =
                self.evaluate(on.map(|c| (c.trial.as_slice(), c.tracks.as_slice())).collect(), None).into_iter();
            for (i, is_lower) in at.into_iter().zip(lower) {
                let fit = if is_lower { fits.next() } else { None };
                climbs[i].advance(fit.and_then(Result::ok), self);
            }
            if on_round().is_break() {
                return Err(FinderError::Cancelled("fit"));
            }
        }
        Ok(climbs.into_iter().map(|c| c.fit).collect())
    }

    /// The decrease of a fit's last step, whose cost is `cost`.
    fn last_decrease(&self, cost: f64) -> f64 {
        self.decrease.max(BEHIND_DECREASE * (cost - self.aim))
    }
}

/// The worse half of the climbs that are left, by their cost so far, is done; the best goes on.
fn give_up(climbs: &mut [Climb]) {
    let mut left: Vec<usize> = (0..climbs.len()).filter(|&i| !climbs[i].done).collect();
    left.sort_by(|&a, &b| climbs[a].fit.cost.total_cmp(&climbs[b].fit.cost));
    left.iter().skip(left.len().div_ceil(2)).for_each(|&i| climbs[i].done = true);
}

impl Climb {
    fn new(seen: Seen, problem: &Problem<'_>) -> Self {
        let Seen { tracks, fit } = seen;
        let mut climb = Self { tracks, trial: fit.point.clone(), fit, damping: DAMPING, done: false };
        climb.choose(problem);
        climb
    }

    /// Takes the trial or leaves it, and chooses the next.
    fn advance(&mut self, trial: Option<Fit>, problem: &Problem<'_>) {
        match trial {
            Some(new) if new.cost < self.fit.cost => {
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

    /// The next trial: a damped step in the coordinates that are free to move.
    fn choose(&mut self, problem: &Problem<'_>) {
        self.trial = stepped(&self.fit, self.damping);
        let predicted = predicted_decrease(&self.fit, &self.trial);
        if predicted < 0.1 * problem.last_decrease(self.fit.cost) {
            self.done = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn in_a_race_the_worse_half_gives_up_and_the_best_goes_on() {
        let fit = |cost| Fit {
            point: vec![0.5],
            cost,
            residuals: DVector::zeros(1),
            jacobian: DMatrix::zeros(1, 1),
            tracks: Vec::new(),
        };
        let climb = |cost, done| Climb { tracks: Vec::new(), fit: fit(cost), trial: vec![0.5], damping: DAMPING, done };
        let mut climbs =
            [climb(5.0, false), climb(1.0, false), climb(0.5, true), climb(3.0, false), climb(f64::NAN, false)];
        let mut heat = || {
            give_up(&mut climbs);
            climbs.each_ref().map(|c| c.done)
        };
        assert_eq!(heat(), [true, false, true, false, true]);
        assert_eq!(heat(), [true, false, true, true, true]);
        assert_eq!(heat(), [true, false, true, true, true], "the last one left has nobody to give up for");
    }
}
