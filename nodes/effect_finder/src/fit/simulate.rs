//! What the simulator says of points, beside what was measured.

use super::{Fit, Problem};
use crate::case::Case;
use crate::unknowns::Scope;
use catenary_core::simulator::{SimulatorError, TrackSensitivities, Until};
use catenary_core::{Fidelity, SimulationRequest, Track};
use nalgebra::{DMatrix, DVector};

/// Of points that cost more than `most` beside a data set nobody asks how much more.
#[derive(Clone, Copy)]
struct Limit<'a> {
    measured: &'a [Track],
    most: f64,
}

/// Sums of squares differ by less than this share where they are summed in another order.
const ROUNDING: f64 = 1e-9;

impl Problem<'_> {
    /// The request for episode `episode` at the points.
    pub fn request(&self, points: &[&[f64]], episode: usize) -> SimulationRequest {
        let values: Vec<Vec<f64>> = points.iter().map(|p| self.unknowns.parameters(p, episode)).collect();
        let theta = self.unknowns.theta();
        let names = self.unknowns.names().into_iter().enumerate().skip(theta);
        SimulationRequest {
            thetas: values.iter().map(|v| v[..theta].to_vec()).collect(),
            effects: names.map(|(i, name)| (name.to_owned(), values.iter().map(|v| v[i]).collect())).collect(),
            ..self.cases[episode].template.clone()
        }
    }

    /// For each of the points a track an episode, without noise.
    ///
    /// # Errors
    /// [`SimulatorError`], where one of the points cannot be simulated.
    pub fn tracks(&self, points: &[&[f64]]) -> Result<Vec<Vec<Track>>, SimulatorError> {
        self.tracks_within(points, None)
    }

    /// The same, where a track may end as soon as its point costs more than the limit.
    fn tracks_within(&self, points: &[&[f64]], limit: Option<Limit<'_>>) -> Result<Vec<Vec<Track>>, SimulatorError> {
        let mut sets = vec![Vec::new(); points.len()];
        let pulled = |p: &&[f64]| self.pulls(p).iter().map(|(pull, ..)| pull * pull).sum();
        // What each point costs so far.
        let mut spent: Vec<f64> = limit.map_or(Vec::new(), |_| points.iter().map(pulled).collect());
        for episode in 0..self.cases.len() {
            let request = self.request(points, episode);
            let case = &self.cases[episode];
            let tracks = match limit {
                None => self.simulator.simulate(&request),
                Some(Limit { measured, most }) => {
                    let (measured, most) = (&measured[episode], (1.0 + ROUNDING) * most);
                    let left: Vec<f64> = spent.iter().map(|spent| most - spent).collect();
                    let until = Until {
                        is_enough: &|place, frames| case.is_enough(measured, frames, left[place]),
                        number: case.number_of(measured, &left),
                    };
                    self.simulator.simulate_until(&request, until)
                }
            }?;
            if tracks.len() != points.len() {
                let (expected, got) = (points.len(), tracks.len());
                return Err(SimulatorError::Backend(format!("expected {expected} tracks, got {got}")));
            }
            for (place, (set, track)) in sets.iter_mut().zip(tracks).enumerate() {
                let track = case.corrected(track);
                if let Some(Limit { measured, .. }) = limit {
                    spent[place] += case.cost(&measured[episode], &track);
                }
                set.push(track);
            }
        }
        Ok(sets)
    }

    /// The episodes, in which simulated tracks are corrected by what those at the point `u` are with that finer fidelity.
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn refined(&self, u: &[f64], fidelity: Fidelity) -> Result<Vec<Case>, SimulatorError> {
        let one = |(episode, case): (usize, &Case)| {
            let coarse = self.request(&[u], episode);
            let fine = SimulationRequest { fidelity, ..coarse.clone() };
            let [fine, coarse] = [fine, coarse].map(|r| self.simulator.simulate(&r).map(|mut t| t.pop()));
            match (fine?, coarse?) {
                (Some(fine), Some(coarse)) => Ok(case.corrected_by(&fine, &coarse)),
                _ => Err(SimulatorError::Backend("expected a track, got none".into())),
            }
        };
        self.cases.iter().enumerate().map(one).collect()
    }

    /// The [tracks](Self::tracks) of each point by itself: one that cannot be simulated fails a batch, and costs no other its tracks here.
    pub fn tracks_each(&self, points: &[Vec<f64>]) -> Vec<Result<Vec<Track>, SimulatorError>> {
        self.tracks_each_within(points, None)
    }

    fn tracks_each_within(
        &self,
        points: &[Vec<f64>],
        limit: Option<Limit<'_>>,
    ) -> Vec<Result<Vec<Track>, SimulatorError>> {
        let at: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
        let none = || SimulatorError::Backend("expected a track, got none".into());
        let alone = |p: &&[f64]| self.tracks_within(&[p], limit)?.pop().ok_or_else(none);
        match self.tracks_within(&at, limit) {
            Ok(sets) => sets.into_iter().map(Ok).collect(),
            Err(_) => at.iter().map(alone).collect(),
        }
    }

    /// The cost of each point beside one data set, without derivatives; infinite where it cannot be simulated.
    pub fn costs(&self, points: &[Vec<f64>], measured: &[Track]) -> Vec<f64> {
        self.costs_to(points, measured, f64::INFINITY)
    }

    /// The same up to `most`; of what costs more, some number above that. Many points cost more long before their episodes end.
    pub fn costs_to(&self, points: &[Vec<f64>], measured: &[Track], most: f64) -> Vec<f64> {
        let limit = most.is_finite().then_some(Limit { measured, most });
        let cost = |(tracks, p): (Result<Vec<Track>, _>, &Vec<f64>)| {
            let cost = tracks.map_or(f64::INFINITY, |t| self.residuals(p, measured, &t).norm_squared());
            if cost.is_nan() { f64::INFINITY } else { cost }
        };
        self.tracks_each_within(points, limit).into_iter().zip(points).map(cost).collect()
    }

    /// Measured less `tracks`, simulated at `point`, in standard deviations of the noise; then the pulls of Gaussian priors.
    pub(super) fn residuals(&self, point: &[f64], measured: &[Track], tracks: &[Track]) -> DVector<f64> {
        let parts = self.cases.iter().zip(measured).zip(tracks).map(|((case, m), t)| case.residuals(m, t));
        let pulls = self.pulls(point).into_iter().map(|(pull, ..)| pull);
        let rows: Vec<f64> = parts.flat_map(|part| part.as_slice().to_vec()).chain(pulls).collect();
        DVector::from_vec(rows)
    }

    /// Those of Gaussian priors that can be followed: (standard deviations off, column, by the coordinate).
    fn pulls(&self, point: &[f64]) -> Vec<(f64, usize, f64)> {
        let mut pulls = self.unknowns.pulls(point);
        if self.is_shared_held {
            let held = |column: usize| self.unknowns.scope_of(column) == Scope::Shared;
            pulls.retain(|p| !held(p.1));
        }
        pulls
    }

    /// The unknowns by which derivatives are taken.
    fn by(&self, known: Option<&DMatrix<f64>>) -> impl Iterator<Item = usize> {
        let list = self.unknowns.list();
        let first = known.map_or(0, |_| list.len() - 1);
        (first..list.len()).filter(|&i| !(self.is_shared_held && list[i].scope == Scope::Shared))
    }

    /// What the simulator says of the points, beside their data sets, or why that is of no use.
    pub(super) fn evaluate(
        &self,
        trials: Vec<(&[f64], &[Track])>,
        known: Option<&DMatrix<f64>>,
    ) -> Vec<Result<Fit, String>> {
        let usable = |fit: Result<Fit, SimulatorError>| match fit {
            Ok(fit) if fit.is_usable() => Ok(fit),
            Ok(_) => Err("the simulated track or its derivatives are not finite, or too steep".to_owned()),
            Err(error) => Err(error.to_string()),
        };
        self.simulate(trials, known).into_iter().map(usable).collect()
    }

    fn simulate(
        &self,
        trials: Vec<(&[f64], &[Track])>,
        known: Option<&DMatrix<f64>>,
    ) -> Vec<Result<Fit, SimulatorError>> {
        let points: Vec<&[f64]> = trials.iter().map(|t| t.0).collect();
        let mut names: Vec<&str> = self.by(known).map(|i| self.unknowns.list()[i].name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let episodes: Result<Vec<_>, _> =
            (0..self.cases.len()).map(|e| self.sensitivities(&points, e, &names)).collect();
        match episodes {
            Ok(episodes) => {
                let of = |member: usize| episodes.iter().map(|e| &e[member]).collect::<Vec<_>>();
                trials
                    .iter()
                    .enumerate()
                    .map(|(i, (point, tracks))| Ok(self.assemble(point, tracks, &of(i), &names, known)))
                    .collect()
            }
            // One point that cannot be simulated fails the batch: each is asked for by itself.
            Err(error) if trials.len() == 1 => vec![Err(error)],
            Err(_) => trials.into_iter().flat_map(|trial| self.simulate(vec![trial], known)).collect(),
        }
    }

    fn sensitivities(
        &self,
        points: &[&[f64]],
        episode: usize,
        names: &[&str],
    ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
        let mut answer = self.simulator.sensitivities(&self.request(points, episode), names)?;
        let is_whole = |s: &TrackSensitivities| s.derivatives.len() == names.len() && !s.track.frames.is_empty();
        if answer.len() != points.len() || !answer.iter().all(is_whole) {
            return Err(SimulatorError::Backend(format!(
                "expected {} tracks with frames and {} derivatives each, got {} tracks",
                points.len(),
                names.len(),
                answer.len()
            )));
        }
        for one in &mut answer {
            one.track = self.cases[episode].corrected(std::mem::take(&mut one.track));
        }
        Ok(answer)
    }

    fn assemble(
        &self,
        point: &[f64],
        tracks: &[Track],
        episodes: &[&TrackSensitivities],
        names: &[&str],
        known: Option<&DMatrix<f64>>,
    ) -> Fit {
        let parts: Vec<_> = self
            .cases
            .iter()
            .zip(tracks)
            .zip(episodes)
            .map(|((case, measured), s)| case.compare(measured, s))
            .collect();
        let pulls = self.pulls(point);
        let rows: usize = parts.iter().map(|p| p.0.len()).sum::<usize>() + pulls.len();
        let mut residuals = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, self.unknowns.columns());
        if let Some(known) = known {
            jacobian.columns_mut(0, known.ncols()).copy_from(known);
        }
        let mut from = 0;
        for (episode, (r, j)) in parts.iter().enumerate() {
            residuals.rows_mut(from, r.len()).copy_from(r);
            let values = self.unknowns.values(point, episode);
            for i in self.by(known) {
                let (unknown, column) = (&self.unknowns.list()[i], self.unknowns.column(i, episode));
                let by = names.iter().position(|name| *name == unknown.name).expect("it was asked for");
                let scaled = j.column(by) * self.unknowns.slope(i, values[i]);
                jacobian.view_mut((from, column), (r.len(), 1)).copy_from(&scaled);
            }
            from += r.len();
        }
        for (i, (pull, column, slope)) in pulls.into_iter().enumerate() {
            residuals[from + i] = pull;
            jacobian[(from + i, column)] = slope;
        }
        let cost = residuals.norm_squared();
        let tracks = episodes.iter().map(|s| s.track.clone()).collect();
        Fit { point: point.to_vec(), cost, residuals, jacobian, tracks }
    }
}
