//! Linearisation of a model at points: residuals and Jacobian against measured tracks.

use super::laplace::Laplace;
use super::problem::{Fit, LinearisedStart, OnRound, Problem, Start};
use crate::data::{Scope, Unknowns};
use crate::error::FitError;
use catenary_core::Track;
use catenary_core::simulator::{SimulatorError, TrackSensitivities};
use nalgebra::{DMatrix, DVector};

/// Derivatives at a fit of fewer unknowns.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// Unknowns of that fit.
    pub unknowns: &'a Unknowns,
    /// Jacobian of that fit.
    pub jacobian: &'a DMatrix<f64>,
}

impl Known<'_> {
    /// Columns of the known unknowns, here and in `all`.
    fn columns_in(self, all: &Unknowns) -> Vec<(usize, usize)> {
        let mut columns = Vec::new();
        for (i, unknown) in all.list().iter().enumerate() {
            let Some(known) = all.place_in(self.unknowns, i) else { continue };
            let episodes = if unknown.scope == Scope::Shared { 1 } else { all.episodes() };
            columns.extend((0..episodes).map(|e| (self.unknowns.column(known, e), all.column(i, e))));
        }
        columns
    }
}

impl Problem<'_> {
    /// Linearises the model at the starts, the first round of a fit; none for a start that cannot be simulated.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn linearise(
        &self,
        starts: Vec<Start>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<LinearisedStart>>, FitError> {
        self.linearise_with(starts, None, on_round)
    }

    /// Linearisation whose Jacobian is computed for the unknowns that `known` lacks only, at a fraction of the cost. The other
    /// columns of the Jacobian are known from a fit without these unknowns.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn linearise_new(
        &self,
        starts: Vec<Start>,
        known: Known<'_>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<LinearisedStart>>, FitError> {
        self.linearise_with(starts, Some(known), on_round)
    }

    fn linearise_with(
        &self,
        starts: Vec<Start>,
        known: Option<Known<'_>>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<LinearisedStart>>, FitError> {
        let at = starts.iter().map(|s| (s.point.as_slice(), s.tracks.as_slice())).collect();
        let fits = self.evaluate(at, known);
        if on_round().is_break() {
            return Err(FitError::Cancelled);
        }
        let mut refusal = String::from("no start was given");
        let mut keep = |fit: Result<Fit, String>| fit.map_err(|reason| refusal = reason).ok();
        let seen = |(start, fit): (Start, Option<Fit>)| fit.map(|fit| LinearisedStart { tracks: start.tracks, fit });
        let fits: Vec<Option<Fit>> = fits.into_iter().map(&mut keep).collect();
        if fits.iter().all(Option::is_none) {
            return Err(FitError::NoFit(refusal));
        }
        Ok(starts.into_iter().zip(fits).map(seen).collect())
    }

    /// Indices of the unknowns whose derivatives are computed: all unknowns that are not `known`. Shared unknowns are left out
    /// if they are held.
    fn by(&self, known: Option<Known<'_>>) -> Vec<usize> {
        let list = self.unknowns.list();
        let is_held = |i: usize| self.is_shared_held && list[i].scope == Scope::Shared;
        let is_known = |i: usize| known.is_some_and(|known| self.unknowns.place_in(known.unknowns, i).is_some());
        (0..list.len()).filter(|&i| !is_held(i) && !is_known(i)).collect()
    }

    /// Linearisations of trials, each a point and a data set; an error says why a point is of no use.
    pub(super) fn evaluate(
        &self,
        trials: Vec<(&[f64], &[Track])>,
        known: Option<Known<'_>>,
    ) -> Vec<Result<Fit, String>> {
        let usable = |fit: Result<Fit, SimulatorError>| match fit {
            Ok(fit) if is_usable(&fit) => Ok(fit),
            Ok(_) => Err("track or derivatives not finite, or Gauss-Newton matrix not positive definite".to_owned()),
            Err(error) => Err(error.to_string()),
        };
        self.simulate(trials, known).into_iter().map(usable).collect()
    }

    fn simulate(&self, trials: Vec<(&[f64], &[Track])>, known: Option<Known<'_>>) -> Vec<Result<Fit, SimulatorError>> {
        let points: Vec<&[f64]> = trials.iter().map(|t| t.0).collect();
        let mut names: Vec<&str> = self.by(known).into_iter().map(|i| self.unknowns.list()[i].name.as_str()).collect();
        names.sort_unstable();
        // The name of an effect can occur twice: as an unknown of each episode and as a candidate. Its derivative is
        // computed once.
        names.dedup();
        let episodes: Result<Vec<_>, _> =
            (0..self.episodes.len()).map(|e| self.sensitivities(&points, e, &names)).collect();
        match episodes {
            Ok(episodes) => {
                let of = |member: usize| episodes.iter().map(|e| &e[member]).collect::<Vec<_>>();
                trials
                    .iter()
                    .enumerate()
                    .map(|(i, (point, tracks))| Ok(self.assemble(point, tracks, &of(i), &names, known)))
                    .collect()
            }
            // A point that cannot be simulated fails the batch, so that each is simulated by itself.
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
            one.track = self.episodes[episode].corrected(std::mem::take(&mut one.track));
        }
        Ok(answer)
    }

    fn assemble(
        &self,
        point: &[f64],
        tracks: &[Track],
        episodes: &[&TrackSensitivities],
        names: &[&str],
        known: Option<Known<'_>>,
    ) -> Fit {
        let parts: Vec<_> = self
            .episodes
            .iter()
            .zip(tracks)
            .zip(episodes)
            .map(|((episode, measured), s)| episode.compare(measured, s))
            .collect();
        let prior_residuals = self.prior_residuals(point);
        let rows: usize = parts.iter().map(|p| p.0.len()).sum::<usize>() + prior_residuals.len();
        let mut residuals = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, self.unknowns.columns());
        // The known columns come from a fit without the new unknowns. They are an approximation that is good enough to rank
        // candidates.
        if let Some(known) = known {
            for (from, to) in known.columns_in(&self.unknowns) {
                jacobian.column_mut(to).copy_from(&known.jacobian.column(from));
            }
        }
        let by = self.by(known);
        let mut from = 0;
        for (episode, (r, j)) in parts.iter().enumerate() {
            residuals.rows_mut(from, r.len()).copy_from(r);
            let values = self.unknowns.values(point, episode);
            for &i in &by {
                let (unknown, column) = (&self.unknowns.list()[i], self.unknowns.column(i, episode));
                let place = names.iter().position(|name| *name == unknown.name).expect("it was asked for");
                let scaled = j.column(place) * self.unknowns.slope(i, values[i]);
                jacobian.view_mut((from, column), (r.len(), 1)).copy_from(&scaled);
            }
            from += r.len();
        }
        for (i, (pull, column, slope)) in prior_residuals.into_iter().enumerate() {
            residuals[from + i] = pull;
            jacobian[(from + i, column)] = slope;
        }
        let cost = residuals.norm_squared();
        let tracks = episodes.iter().map(|s| s.track.clone()).collect();
        Fit { point: point.to_vec(), cost, residuals, jacobian, tracks }
    }
}

/// Returns whether the linearisation is of use: finite, with a positive definite Gauss-Newton matrix. Derivatives can be
/// too large for that near a point at which the object switches between two folded shapes.
fn is_usable(fit: &Fit) -> bool {
    fit.cost.is_finite() && fit.jacobian.iter().all(|v| v.is_finite()) && Laplace::of(fit).is_some()
}
