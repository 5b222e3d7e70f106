//! Fits of a model to measured tracks: Levenberg and Marquardt's least squares within the priors' support.
//!
//! Many data sets of the same episodes are fitted in step, so that each round is one batch for the simulator.

mod climb;
mod refit;
mod simulate;
mod step;

pub use refit::Simulated;
pub use step::presses;

use crate::case::{Case, Channel};
use crate::error::FinderError;
use crate::laplace::Laplace;
use crate::unknowns::Unknowns;
use catenary_core::{DifferentiableSimulator, Model, Track};
use nalgebra::{DMatrix, DVector};
use std::ops::ControlFlow;

/// A fit ends where a step lowers the sum of squares by less than this: its own scatter is some ten.
const DECREASE: f64 = 0.02;
/// Points that are simulated between two chances to stop, and to learn what the best of them cost.
const BATCH: usize = 32;
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
            // What costs more than that many others is none of those that are asked for, however much more it is.
            let most = count.checked_sub(1).and_then(|last| ranked.get(last)).map_or(f64::INFINITY, |worst| worst.0);
            ranked.extend(self.costs_to(&part, &measured, most).into_iter().zip(part));
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
            ranked.truncate(count);
            if on_round().is_break() {
                return Err(FinderError::Cancelled("fit"));
            }
        }
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::{self, Toy};
    use catenary_core::simulator::{SimulatorError, TrackSensitivities, Until};
    use catenary_core::{SimulationRequest, Simulator, seed};
    use rand::RngExt;
    use std::sync::atomic::{AtomicUsize, Ordering};

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

    /// The toy, whose episodes end where nobody asks for more; it counts frames.
    struct Ending {
        toy: Toy,
        frames: AtomicUsize,
    }

    impl Simulator for Ending {
        fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
            self.toy.simulate(request)
        }

        fn simulate_until(&self, request: &SimulationRequest, until: Until<'_>) -> Result<Vec<Track>, SimulatorError> {
            let mut tracks = self.toy.simulate(request)?;
            for (place, track) in tracks.iter_mut().enumerate() {
                let is_enough = |count: &usize| (until.is_enough)(place, &track.frames[..*count]);
                let count = (1..track.frames.len()).find(is_enough).unwrap_or(track.frames.len());
                track.frames.truncate(count);
                self.frames.fetch_add(count, Ordering::Relaxed);
            }
            Ok(tracks)
        }
    }

    impl DifferentiableSimulator for Ending {
        fn sensitivities(
            &self,
            request: &SimulationRequest,
            names: &[&str],
        ) -> Result<Vec<TrackSensitivities>, SimulatorError> {
            self.toy.sensitivities(request, names)
        }
    }

    #[test]
    fn the_cheapest_points_are_found_without_the_end_of_what_costs_more() {
        let (toy, ending) = (Toy { gain: 0.3 }, Ending { toy: Toy { gain: 0.3 }, frames: AtomicUsize::new(0) });
        let noisy = |i| toy::case(&toy, [0.25, 2e4], &[]).measured_anew(&mut seed::rng(13, i));
        let cases = [noisy(0), noisy(1)];
        let mut rng = seed::rng(14, 0);
        // Some lie near what was measured, and some cannot be simulated.
        let near = |i: usize| if i.is_multiple_of(5) { 0.1 } else { 1.0 };
        let points: Vec<Vec<f64>> = (0..200)
            .map(|i| (0..2).map(|_| (0.5 + near(i) * (rng.random::<f64>() - 0.5)).clamp(0.0, 1.0)).collect())
            .collect();
        let found = |simulator: &dyn DifferentiableSimulator, count: usize| {
            let problem = Problem::of(&toy::model(), &cases, simulator, 40);
            let starts = problem.cheapest(points.clone(), count, &mut || ControlFlow::Continue(())).unwrap();
            starts.into_iter().map(|s| s.point).collect::<Vec<_>>()
        };
        let mut known: Vec<Vec<f64>> = points.clone();
        let costs = Problem::of(&toy::model(), &cases, &toy, 40);
        let cost = |p: &Vec<f64>| costs.costs(std::slice::from_ref(p), &costs.measured())[0];
        known.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        for count in [0, 1, 8, 32, 199, 200, 300] {
            assert_eq!(found(&ending, count), known[..count.min(200)], "{count}");
        }
        ending.frames.store(0, Ordering::Relaxed);
        found(&ending, 8);
        let refused: Vec<f64> = costs.costs(&[vec![0.0, 0.5], vec![0.5, f64::NAN]], &costs.measured());
        assert_eq!(refused, [f64::INFINITY; 2], "what cannot be simulated, and what is no number");
        let whole = (points.len() - BATCH) * cases.len() * toy::FRAMES;
        let share = ending.frames.load(Ordering::Relaxed) as f64 / whole as f64;
        assert!(share < 0.6, "{share} of the frames");
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
}
