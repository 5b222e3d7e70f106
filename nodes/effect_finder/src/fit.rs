//! Fits of a model to measured tracks: Levenberg and Marquardt's least squares within the priors' support.
//!
//! Many data sets of the same episodes are fitted in step, so that each round is one batch for the simulator.

mod refit;

pub use refit::Simulated;

use crate::case::{Case, Channel};
use crate::error::FinderError;
use crate::laplace::Laplace;
use crate::unknowns::{Scope, Unknowns};
use catenary_core::simulator::{SimulatorError, TrackSensitivities};
use catenary_core::{DifferentiableSimulator, Fidelity, Model, SimulationRequest, Track};
use nalgebra::{DMatrix, DVector};
use std::ops::ControlFlow;

/// A fit ends where a step lowers the sum of squares by less than this: its own scatter is some ten.
const DECREASE: f64 = 0.02;
/// First damping, relative to the curvature.
const DAMPING: f64 = 1e-3;
/// Damping at which a fit that finds no lower point ends.
const GREATEST_DAMPING: f64 = 1e6;
/// The same of a fit that lies above what others came to, as a share of by how much.
const BEHIND_DECREASE: f64 = 0.01;
/// Rounds of a race after which the worse half gives up.
const HEAT: usize = 4;
/// Points that are simulated between two chances to stop.
const BATCH: usize = 64;
/// Most rounds of a linear descent: each takes a coordinate to its edge, or ends it.
const LINEAR_ROUNDS: usize = 50;
/// A linear descent ends where a round lowers the cost by less than this share of it.
const LINEAR_DECREASE: f64 = 1e-9;
/// Share of the coordinates' range that is added to the curvature of directions that change nothing.
const RIDGE: f64 = 1e-6;
/// How many times as many starts are tried where the best cannot be followed.
const TRIES: usize = 4;

/// Asked after each round of a fit, whether to go on.
pub type OnRound<'a> = &'a mut dyn FnMut() -> ControlFlow<()>;

/// What a model is fitted to, and what may be changed.
pub struct Problem<'a> {
    /// The simulator of the model.
    pub simulator: &'a dyn DifferentiableSimulator,
    /// What may be changed.
    pub unknowns: Unknowns,
    /// The episodes.
    pub cases: &'a [Case],
    /// Rounds after which a fit ends, the look at its start among them.
    pub rounds: usize,
    /// Whether what all episodes share stays where a fit starts, and only the rest is changed.
    pub is_shared_held: bool,
    /// A fit ends where a step lowers the cost by less than this.
    pub decrease: f64,
    /// Cost that another model came to: a fit that lies far above it ends sooner. Infinite: there is none.
    pub aim: f64,
}

/// One data set, and where its fit starts.
#[derive(Debug, Clone)]
pub struct Start {
    /// The point, in unit coordinates, a number a column of the unknowns.
    pub point: Vec<f64>,
    /// What was measured, a track an episode.
    pub tracks: Vec<Track>,
}

/// A start that could be simulated.
#[derive(Debug, Clone)]
pub struct Seen {
    /// What was measured, a track an episode.
    pub tracks: Vec<Track>,
    /// The start, as the simulator sees it.
    pub fit: Fit,
}

/// A point with what the simulator says of it.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The point, in unit coordinates.
    pub point: Vec<f64>,
    /// Sum of the squares of the whitened residuals, T.
    pub cost: f64,
    /// Measured less simulated, in standard deviations of the noise, a row a channel; then a row for each Gaussian prior.
    pub residuals: DVector<f64>,
    /// How the simulated values change with the coordinates, rows as the residuals, in the same unit.
    pub jacobian: DMatrix<f64>,
    /// The simulated tracks, one an episode; of a fit that has [`descended`](Fit::descended), those of where it came from.
    pub tracks: Vec<Track>,
}

impl Fit {
    /// Whether the cost is a number, and the derivatives are of use: on the crest between folds they may be so large that no
    /// curvature comes of them.
    fn is_usable(&self) -> bool {
        self.cost.is_finite() && self.jacobian.iter().all(|v| v.is_finite()) && Laplace::of(self).is_some()
    }

    /// Half the gradient of the cost by the coordinates.
    pub fn gradient(&self) -> DVector<f64> {
        -(self.jacobian.transpose() * &self.residuals)
    }

    /// Half the curvature of the cost by the coordinates, after Gauss and Newton.
    pub fn curvature(&self) -> DMatrix<f64> {
        self.jacobian.transpose() * &self.jacobian
    }

    /// The way from here to `point`.
    fn way_to(&self, point: &[f64]) -> DVector<f64> {
        DVector::from_iterator(point.len(), point.iter().zip(&self.point).map(|(a, b)| a - b))
    }

    /// Where the cost within the priors' support would be least if the simulator were linear about this point.
    #[must_use]
    pub fn descended(mut self) -> Self {
        for _ in 0..LINEAR_ROUNDS {
            let point = stepped(&self, 0.0);
            let residuals = &self.residuals - &self.jacobian * self.way_to(&point);
            let cost = residuals.norm_squared();
            if self.cost - cost <= LINEAR_DECREASE * self.cost {
                break;
            }
            (self.point, self.residuals, self.cost) = (point, residuals, cost);
        }
        self
    }
}

/// Whether a coordinate `u` lies at an edge of its range, and the cost, whose gradient by it is `g` or a multiple, is less
/// beyond it.
pub fn presses(u: f64, g: f64) -> bool {
    (u <= 0.0 && g > 0.0) || (u >= 1.0 && g < 0.0)
}

/// A fit under way.
struct Climb {
    tracks: Vec<Track>,
    fit: Fit,
    trial: Vec<f64>,
    damping: f64,
    done: bool,
}

impl<'a> Problem<'a> {
    /// The problem of fitting `model` to `cases`.
    pub fn of(model: &Model, cases: &'a [Case], simulator: &'a dyn DifferentiableSimulator, rounds: usize) -> Self {
        let unknowns = Unknowns::of(model, cases.len());
        let (is_shared_held, decrease, aim) = (false, DECREASE, f64::INFINITY);
        Problem { simulator, unknowns, cases, rounds, is_shared_held, decrease, aim }
    }
}

impl Problem<'_> {
    /// What each row of residuals is a difference of.
    pub fn channels(&self) -> Vec<Channel> {
        self.cases.iter().enumerate().flat_map(|(i, case)| case.channels(i)).collect()
    }

    /// The measured tracks.
    pub fn measured(&self) -> Vec<Track> {
        self.cases.iter().map(|c| c.measured.clone()).collect()
    }

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
        let mut sets = vec![Vec::new(); points.len()];
        for episode in 0..self.cases.len() {
            let tracks = self.simulator.simulate(&self.request(points, episode))?;
            if tracks.len() != points.len() {
                let (expected, got) = (points.len(), tracks.len());
                return Err(SimulatorError::Backend(format!("expected {expected} tracks, got {got}")));
            }
            let case = &self.cases[episode];
            sets.iter_mut().zip(tracks).for_each(|(set, track)| set.push(case.corrected(track)));
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

    /// The same of each point by itself: one that cannot be simulated fails a batch, and costs no other its tracks here.
    pub fn tracks_each(&self, points: &[Vec<f64>]) -> Vec<Result<Vec<Track>, SimulatorError>> {
        let at: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
        let none = || SimulatorError::Backend("expected a track, got none".into());
        let alone = |p: &&[f64]| self.tracks(&[p])?.pop().ok_or_else(none);
        match self.tracks(&at) {
            Ok(sets) => sets.into_iter().map(Ok).collect(),
            Err(_) => at.iter().map(alone).collect(),
        }
    }

    /// The cost of each point beside one data set, without derivatives; infinite where it cannot be simulated.
    pub fn costs(&self, points: &[Vec<f64>], measured: &[Track]) -> Vec<f64> {
        let each = self.tracks_each(points).into_iter().zip(points);
        each.map(|(tracks, p)| tracks.map_or(f64::INFINITY, |t| self.residuals(p, measured, &t).norm_squared()))
            .collect()
    }

    /// Measured less `tracks`, simulated at `point`, in standard deviations of the noise; then the pulls of Gaussian priors.
    fn residuals(&self, point: &[f64], measured: &[Track], tracks: &[Track]) -> DVector<f64> {
        let alone =
            |track: &Track| TrackSensitivities { track: track.clone(), derivatives: Vec::new(), changes: Vec::new() };
        let parts = self.cases.iter().zip(measured).zip(tracks).map(|((case, m), t)| case.compare(m, &alone(t)).0);
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

    /// The best fit to the measured tracks, from the best `starts` of the points, or where none of these can be followed, from
    /// the next.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn best_of(&self, points: Vec<Vec<f64>>, starts: usize, on_round: OnRound<'_>) -> Result<Fit, FinderError> {
        let ranked = self.cheapest(points, TRIES * starts, on_round)?;
        let mut refusal = FinderError::NoFit("no start was given".into());
        for part in ranked.chunks(starts.max(1)) {
            match self.look(part.to_vec(), on_round) {
                Ok(seen) => return self.race(seen.into_iter().flatten().collect(), on_round),
                Err(none @ FinderError::NoFit(_)) => refusal = none,
                Err(other) => return Err(other),
            }
        }
        Err(refusal)
    }

    /// The best of the fits of one data set from all these starts: the worse half of those that are left gives up now and then.
    ///
    /// # Errors
    /// As [`Problem::climb`]; [`FinderError::NoFit`] where there is no start.
    pub fn race(&self, seen: Vec<Seen>, on_round: OnRound<'_>) -> Result<Fit, FinderError> {
        let fits = self.climb_on(seen, true, on_round)?.into_iter();
        fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).ok_or_else(|| FinderError::NoFit("no start was left".into()))
    }

    /// Fits of what was measured that begin at the `count` of `points` that cost least.
    ///
    /// # Errors
    /// [`FinderError::Cancelled`] where `on_round` asked to stop.
    pub fn cheapest(
        &self,
        points: Vec<Vec<f64>>,
        count: usize,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Start>, FinderError> {
        let measured = self.measured();
        let mut ranked: Vec<(f64, Vec<f64>)> = Vec::new();
        let mut rest = points.into_iter().peekable();
        while rest.peek().is_some() {
            let part: Vec<Vec<f64>> = rest.by_ref().take(BATCH).collect();
            ranked.extend(self.costs(&part, &measured).into_iter().zip(part));
            if on_round().is_break() {
                return Err(FinderError::Cancelled("fit"));
            }
        }
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(count);
        Ok(ranked.into_iter().map(|(_, point)| Start { point, tracks: measured.clone() }).collect())
    }

    /// Fits each data set from its start. None stands for one whose start could not be simulated.
    ///
    /// # Errors
    /// [`FinderError::NoFit`] where none could be, [`FinderError::Cancelled`] where `on_round` asked to stop.
    pub fn fit(&self, starts: Vec<Start>, on_round: OnRound<'_>) -> Result<Vec<Option<Fit>>, FinderError> {
        let seen = self.look(starts, on_round)?;
        let is_seen: Vec<bool> = seen.iter().map(Option::is_some).collect();
        let mut fits = self.climb(seen.into_iter().flatten().collect(), on_round)?.into_iter();
        Ok(is_seen.into_iter().map(|is_seen| if is_seen { fits.next() } else { None }).collect())
    }

    /// The first round of a fit: what the simulator says of the starts. None stands for one that could not be simulated.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn look(&self, starts: Vec<Start>, on_round: OnRound<'_>) -> Result<Vec<Option<Seen>>, FinderError> {
        self.look_with(starts, None, on_round)
    }

    /// The same at a fraction of its cost: derivatives are by the last unknown alone, those by the others are `known`, from a
    /// fit without it.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn glance(
        &self,
        starts: Vec<Start>,
        known: &DMatrix<f64>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<Seen>>, FinderError> {
        self.look_with(starts, Some(known), on_round)
    }

    fn look_with(
        &self,
        starts: Vec<Start>,
        known: Option<&DMatrix<f64>>,
        on_round: OnRound<'_>,
    ) -> Result<Vec<Option<Seen>>, FinderError> {
        let at = starts.iter().map(|s| (s.point.as_slice(), s.tracks.as_slice())).collect();
        let fits = self.evaluate(at, known);
        if on_round().is_break() {
            return Err(FinderError::Cancelled("fit"));
        }
        let mut refusal = String::from("no start was given");
        let mut keep = |fit: Result<Fit, String>| fit.map_err(|reason| refusal = reason).ok();
        let seen = |(start, fit): (Start, Option<Fit>)| fit.map(|fit| Seen { tracks: start.tracks, fit });
        let fits: Vec<Option<Fit>> = fits.into_iter().map(&mut keep).collect();
        if fits.iter().all(Option::is_none) {
            return Err(FinderError::NoFit(refusal));
        }
        Ok(starts.into_iter().zip(fits).map(seen).collect())
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

    /// The unknowns by which derivatives are taken.
    fn by(&self, known: Option<&DMatrix<f64>>) -> impl Iterator<Item = usize> {
        let list = self.unknowns.list();
        let first = known.map_or(0, |_| list.len() - 1);
        (first..list.len()).filter(|&i| !(self.is_shared_held && list[i].scope == Scope::Shared))
    }

    /// What the simulator says of the points, beside their data sets, or why that is of no use.
    fn evaluate(&self, trials: Vec<(&[f64], &[Track])>, known: Option<&DMatrix<f64>>) -> Vec<Result<Fit, String>> {
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

/// How much lower the cost would be at `trial` if the simulator were linear.
fn predicted_decrease(fit: &Fit, trial: &[f64]) -> f64 {
    fit.cost - (&fit.residuals - &fit.jacobian * fit.way_to(trial)).norm_squared()
}

/// Where a damped step leads to.
fn stepped(fit: &Fit, damping: f64) -> Vec<f64> {
    fit.point.iter().zip(step(fit, damping).iter()).map(|(u, d)| (u + d).clamp(0.0, 1.0)).collect()
}

/// A damped step that does not leave the unit cube from its faces: coordinates at an edge that would go beyond it are held.
fn step(fit: &Fit, damping: f64) -> DVector<f64> {
    let (gradient, curvature) = (fit.gradient(), fit.curvature());
    let n = gradient.len();
    let mut free: Vec<usize> = (0..n).filter(|&i| !presses(fit.point[i], gradient[i])).collect();
    let mut step = DVector::zeros(n);
    loop {
        let k = free.len();
        let mut matrix = DMatrix::from_fn(k, k, |i, j| curvature[(free[i], free[j])]);
        for i in 0..k {
            matrix[(i, i)] += damping * curvature[(free[i], free[i])] + RIDGE;
        }
        let right = DVector::from_fn(k, |i, _| -gradient[free[i]]);
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { return step };
        // A coordinate at an edge that the whole step drives outward is held, too, and the others are solved for again.
        let leaves = |(i, d): &(&usize, &f64)| presses(fit.point[**i], -**d);
        let held: Vec<usize> = free.iter().zip(solved.iter()).filter(leaves).map(|(&i, _)| i).collect();
        if held.is_empty() {
            step.fill(0.0);
            free.iter().zip(solved.iter()).for_each(|(&i, d)| step[i] = *d);
            return step;
        }
        free.retain(|i| !held.contains(i));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};
    use catenary_core::seed;

    fn fit(cases: &[Case], points: &[[f64; 2]]) -> Result<Vec<Option<Fit>>, FinderError> {
        let toy = Toy { gain: 0.3 };
        let problem = Problem::of(&toy::model(), cases, &toy, 40);
        let start = |p: &[f64; 2]| Start { point: p.to_vec(), tracks: problem.measured() };
        problem.fit(points.iter().map(start).collect(), &mut || ControlFlow::Continue(()))
    }

    #[test]
    fn exact_data_are_fitted_exactly_from_any_start() {
        let cases = [toy::case(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
        for fit in fit(&cases, &[[0.5, 0.5], [0.1, 0.95], [1.0, 0.0]]).unwrap() {
            let fit = fit.unwrap();
            let values = Unknowns::of(&toy::model(), 1).values(&fit.point, 0);
            assert!(
                fit.cost < 0.1 && (values[0] - 0.25).abs() < 1e-3 && (values[1] / 2e4 - 1.0).abs() < 0.02,
                "{values:?}"
            );
        }
    }

    /// The least squares of a linear model leave N - d squared deviations on average.
    #[test]
    fn what_is_left_has_the_degrees_of_freedom_of_the_data_less_the_unknowns() {
        let case = toy::case(&Toy { gain: 0.3 }, [0.25, 2e4], &[]);
        let costs: Vec<f64> = (0..200)
            .map(|i| {
                let noisy = case.measured_anew(&mut seed::rng(11, i));
                fit(&[noisy], &[[0.5, 0.5]]).unwrap().remove(0).unwrap().cost
            })
            .collect();
        let mean = costs.iter().sum::<f64>() / 200.0;
        let expected = (8 * toy::FRAMES - 2) as f64;
        // The standard deviation of the mean is sqrt(2 N / 200) = 1.3.
        assert!((mean - expected).abs() < 4.0, "{mean} for {expected}");
    }

    #[test]
    fn a_value_beyond_the_edge_presses_on_it() {
        let cases = [toy::case(&Toy { gain: 0.3 }, [0.35, 2e4], &[])];
        let fit = fit(&cases, &[[0.5, 0.5]]).unwrap().remove(0).unwrap();
        let presses = |column: usize| presses(fit.point[column], fit.gradient()[column]);
        assert!(fit.point[0] == 1.0 && presses(0) && !presses(1), "{:?}", fit.point);
    }

    #[test]
    fn a_start_that_cannot_be_simulated_costs_no_other_its_fit() {
        let cases = [toy::case(&Toy { gain: 0.3 }, [0.25, 2e4], &[])];
        let fits = fit(&cases, &[[0.5, 0.5], [0.0, 0.5]]).unwrap();
        assert!(fits[0].as_ref().is_some_and(|f| f.cost < 0.1) && fits[1].is_none());
        let refusal = fit(&cases, &[[0.0, 0.5]]).unwrap_err().to_string();
        assert!(refusal.contains("length_m: expected at least 0.2"), "{refusal}");
    }

    #[test]
    fn on_the_crest_between_folds_no_fit_starts() {
        let (steep, theta) = (Toy { gain: 1e200 }, [0.25, 2e4]);
        let cases = [toy::case(&steep, theta, &[])];
        let problem = Problem::of(&toy::model(), &cases, &steep, 40);
        let point: Vec<f64> = problem.unknowns.list().iter().zip(theta).map(|(u, v)| u.prior.to_unit(v)).collect();
        let start = Start { point, tracks: problem.measured() };
        let refusal = problem.fit(vec![start], &mut || ControlFlow::Continue(())).unwrap_err().to_string();
        assert!(refusal.contains("too steep"), "{refusal}");
    }

    #[test]
    fn where_the_best_points_cannot_be_followed_the_next_are() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        // Lengths begin at 0.195 m; the toy has none under 0.2 m.
        let points = vec![vec![0.0, 0.5], vec![0.01, 0.5], vec![0.5, 0.5]];
        let best = problem.best_of(points.clone(), 1, &mut || ControlFlow::Continue(())).unwrap();
        assert!(best.cost < 0.1, "{}", best.cost);
        let none = problem.best_of(points[..2].to_vec(), 1, &mut || ControlFlow::Continue(()));
        assert!(matches!(none, Err(FinderError::NoFit(_))));
    }

    #[test]
    fn a_fit_stops_when_it_is_told_to() {
        let toy = Toy { gain: 0.3 };
        let cases = [toy::case(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &cases, &toy, 40);
        let start = Start { point: vec![0.5; 2], tracks: problem.measured() };
        let stopped = problem.fit(vec![start], &mut || ControlFlow::Break(()));
        assert!(matches!(stopped, Err(FinderError::Cancelled(_))));
    }

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
