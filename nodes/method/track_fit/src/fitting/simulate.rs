//! Simulations at points: tracks, costs, residuals, and fidelity corrections.

use super::problem::Problem;
use crate::data::{MeasuredEpisode, Scope};
use catenary_core::simulator::{SimulatorError, Until};
use catenary_core::{Fidelity, SimulationRequest, Track};
use nalgebra::DVector;

/// Cost limits. The simulation of a point may stop once its cost against `measured` exceeds its number in `most`.
#[derive(Clone, Copy)]
struct Limit<'a> {
    measured: &'a [Track],
    most: &'a [f64],
}

/// Relative rounding error of a sum of squares whose terms are added in another order.
const ROUNDING: f64 = 1e-9;

impl Problem<'_> {
    /// Simulation request of episode number `episode` at the points.
    pub fn request(&self, points: &[&[f64]], episode: usize) -> SimulationRequest {
        let values: Vec<Vec<f64>> = points.iter().map(|p| self.unknowns.parameters(p, episode)).collect();
        let theta = self.unknowns.theta();
        // The names after theta's are effects.
        let names = self.unknowns.names().into_iter().enumerate().skip(theta);
        SimulationRequest {
            thetas: values.iter().map(|v| v[..theta].to_vec()).collect(),
            effects: names.map(|(i, name)| (name.to_owned(), values.iter().map(|v| v[i]).collect())).collect(),
            ..self.episodes[episode].template.clone()
        }
    }

    /// Tracks without noise. Each point has one track per episode.
    ///
    /// # Errors
    /// [`SimulatorError`] if one of the points cannot be simulated.
    pub fn tracks(&self, points: &[&[f64]]) -> Result<Vec<Vec<Track>>, SimulatorError> {
        self.tracks_within(points, None)
    }

    /// Tracks as [`Self::tracks`]; with a limit, a track may end once its point costs more.
    fn tracks_within(&self, points: &[&[f64]], limit: Option<Limit<'_>>) -> Result<Vec<Vec<Track>>, SimulatorError> {
        let mut sets = vec![Vec::new(); points.len()];
        let pulled = |p: &&[f64]| self.prior_residuals(p).iter().map(|(pull, ..)| pull * pull).sum();
        // Cost of each point so far.
        let mut spent: Vec<f64> = limit.map_or(Vec::new(), |_| points.iter().map(pulled).collect());
        for index in 0..self.episodes.len() {
            let request = self.request(points, index);
            let episode = &self.episodes[index];
            let tracks = match limit {
                None => self.simulator.simulate(&request),
                Some(Limit { measured, most }) => {
                    // A simulation must not end for a cost that exceeds the limit by rounding alone.
                    let measured = &measured[index];
                    let left: Vec<f64> =
                        spent.iter().zip(most).map(|(spent, most)| most + ROUNDING * most.abs() - spent).collect();
                    let until = Until {
                        is_enough: &|place, frames| episode.is_enough(measured, frames, left[place]),
                        number: episode.stop_fingerprint(measured, &left),
                    };
                    self.simulator.simulate_until(&request, until)
                }
            }?;
            if tracks.len() != points.len() {
                let (expected, got) = (points.len(), tracks.len());
                return Err(SimulatorError::Backend(format!("expected {expected} tracks, got {got}")));
            }
            for (place, (set, track)) in sets.iter_mut().zip(tracks).enumerate() {
                let track = episode.corrected(track);
                if let Some(Limit { measured, .. }) = limit {
                    spent[place] += episode.cost(&measured[index], &track);
                }
                set.push(track);
            }
        }
        Ok(sets)
    }

    /// Episodes with the fidelity correction of the point `u`: the difference between simulations at `fidelity` and at
    /// the episodes' own.
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn corrected_episodes(&self, u: &[f64], fidelity: Fidelity) -> Result<Vec<MeasuredEpisode>, SimulatorError> {
        let one = |(index, episode): (usize, &MeasuredEpisode)| {
            let coarse = self.request(&[u], index);
            let fine = SimulationRequest { fidelity, ..coarse.clone() };
            let [fine, coarse] = [fine, coarse].map(|r| self.simulator.simulate(&r).map(|mut t| t.pop()));
            match (fine?, coarse?) {
                (Some(fine), Some(coarse)) => Ok(episode.corrected_by(&fine, &coarse)),
                _ => Err(SimulatorError::Backend("expected a track, got none".into())),
            }
        };
        self.episodes.iter().enumerate().map(one).collect()
    }

    /// [Tracks](Self::tracks) of each point by itself. A point that cannot be simulated does not fail the others.
    pub fn tracks_each(&self, points: &[Vec<f64>]) -> Vec<Result<Vec<Track>, SimulatorError>> {
        self.tracks_each_within(points, None)
    }

    fn tracks_each_within(
        &self,
        // A batch fails if one of its points fails. Each point is then simulated alone.
        points: &[Vec<f64>],
        limit: Option<Limit<'_>>,
    ) -> Vec<Result<Vec<Track>, SimulatorError>> {
        let at: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
        let none = || SimulatorError::Backend("expected a track, got none".into());
        let alone = |(i, p): (usize, &&[f64])| {
            let own = limit.map(|limit| Limit { most: &limit.most[i..=i], ..limit });
            self.tracks_within(&[p], own)?.pop().ok_or_else(none)
        };
        match self.tracks_within(&at, limit) {
            Ok(sets) => sets.into_iter().map(Ok).collect(),
            Err(_) => at.iter().enumerate().map(alone).collect(),
        }
    }

    /// Costs of the points against `measured`, without derivatives; infinite for a point that cannot be simulated.
    pub fn costs(&self, points: &[Vec<f64>], measured: &[Track]) -> Vec<f64> {
        self.costs_to(points, measured, f64::INFINITY)
    }

    /// Costs as [`Self::costs`] up to `most`; a point that costs more gets some number above `most`. The majority of points
    /// exceed the limit long before their episodes end, which saves time.
    pub fn costs_to(&self, points: &[Vec<f64>], measured: &[Track], most: f64) -> Vec<f64> {
        self.costs_each_to(points, measured, &vec![most; points.len()])
    }

    /// Costs as [`Self::costs_to`], with a limit for each point.
    pub fn costs_each_to(&self, points: &[Vec<f64>], measured: &[Track], most: &[f64]) -> Vec<f64> {
        let limit = most.iter().any(|most| most.is_finite()).then_some(Limit { measured, most });
        let cost = |(tracks, p): (Result<Vec<Track>, _>, &Vec<f64>)| {
            let cost = tracks.map_or(f64::INFINITY, |t| self.residuals(p, measured, &t).norm_squared());
            // A cost that is not a number counts as a failed simulation.
            if cost.is_nan() { f64::INFINITY } else { cost }
        };
        self.tracks_each_within(points, limit).into_iter().zip(points).map(cost).collect()
    }

    /// Residuals: measured less simulated, in standard deviations of the noise, followed by the residuals of Gaussian
    /// priors.
    pub(super) fn residuals(&self, point: &[f64], measured: &[Track], tracks: &[Track]) -> DVector<f64> {
        let parts = self.episodes.iter().zip(measured).zip(tracks).map(|((episode, m), t)| episode.residuals(m, t));
        let prior_residuals = self.prior_residuals(point).into_iter().map(|(pull, ..)| pull);
        let rows: Vec<f64> = parts.flat_map(|part| part.as_slice().to_vec()).chain(prior_residuals).collect();
        DVector::from_vec(rows)
    }

    /// Residuals of the Gaussian priors: (residual, column, derivative with respect to the coordinate). Priors of shared
    /// unknowns are left out if these are held.
    pub(super) fn prior_residuals(&self, point: &[f64]) -> Vec<(f64, usize, f64)> {
        let mut prior_residuals = self.unknowns.prior_residuals(point);
        if self.is_shared_held {
            let held = |column: usize| self.unknowns.scope_of(column) == Scope::Shared;
            prior_residuals.retain(|p| !held(p.1));
        }
        prior_residuals
    }
}
