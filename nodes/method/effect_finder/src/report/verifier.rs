//! Verification of a repair on episodes that no fit has seen.
//!
//! Shared unknowns are taken from the fit; unknowns drawn for each episode are fitted to it. The noise floor is the
//! residual of the repaired model on repeats that are simulated from it and treated the same way.

use super::black_box::BlackBox;
use super::draws::Draws;
use super::scores::{closed_interval, cost, energy_score_mm, share_closed, share_explained};
use super::verification::{Score, Verification};
use crate::error::FinderError;
use crate::evidence::{Hypothesis, p_value};
use crate::settings::Settings;
use catenary_core::statistics::mean;
use catenary_core::{Camera, Track, seed};
use nalgebra::DVector;
use rand::RngExt;
use track_fit::FitError;
use track_fit::data::{MeasuredEpisode, Offset, Scope, offsets_mm, rmse_mm};
use track_fit::fitting::{FidelityCorrection, Fit, Laplace, OnRound, Problem, SimulatedSet, Start, corrected_fit};

/// Random streams of predictions, repeats, bootstrap, starts of fits, and null sets.
const STREAMS: [u64; 5] = [2001, 2002, 2003, 2004, 2005];
/// Draws of an episode's own unknowns among which its fits choose their starts.
const DRAWS: usize = 64;
/// Number of draws from which a fit starts.
const STARTS: usize = 3;
/// Number of predictions behind an energy score.
pub(crate) const PREDICTIONS: usize = 20;
/// Number of repeats behind the noise floor.
const REPEATS: usize = 8;
/// Number of null sets of the held-out test.
const TESTED: usize = 199;
/// Null sets that are fitted in step.
const SLICE: usize = 25;

/// Verifier of models on held-out episodes.
pub struct Verifier<'a> {
    /// Problem of the search, with the fitted episodes.
    pub problem: &'a Problem<'a>,
    /// Episodes that the fit has not seen.
    pub episodes: &'a [MeasuredEpisode],
    /// Camera of the episodes.
    pub camera: &'a Camera,
    /// Settings of the search.
    pub settings: &'a Settings,
}

/// Predictions of the held-out episodes by a model.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Tracks at the best fit of the episodes' own unknowns, one an episode.
    pub tracks: Vec<Track>,
    /// Offsets of the measured keypoints from the predicted ones, by episode and frame.
    pub offsets: Vec<Vec<Offset>>,
    /// Draws of the prediction with noise, by episode and draw. Draws that cannot be simulated are missing.
    pub draws: Vec<Vec<Track>>,
    /// Number of draws that could not be simulated.
    pub left_out: usize,
    /// Scores of the predictions.
    pub score: Score,
    fits: Vec<Fit>,
    /// Episodes of the fits, with their fidelity correction.
    episodes: Vec<MeasuredEpisode>,
}

impl Prediction {
    /// Residuals of all episodes at the best fit of their own unknowns, in standard deviations of the noise, a row a channel.
    pub fn residuals(&self) -> DVector<f64> {
        let rows = |(episode, fit): (&MeasuredEpisode, &Fit)| {
            // Rows of Gaussian priors follow the channels.
            fit.residuals.iter().take(episode.channels(0).len()).copied().collect::<Vec<f64>>()
        };
        DVector::from_vec(self.episodes.iter().zip(&self.fits).flat_map(rows).collect())
    }

    /// Residual energy of all episodes, in variances of the noise.
    pub fn cost(&self) -> f64 {
        cost(&self.fits)
    }
}

impl Verifier<'_> {
    /// Compares the models on the held-out episodes; returns the predictions of `before` and `after`, too. The p-value of a
    /// `known` verification is taken over.
    ///
    /// # Errors
    /// [`FinderError`] of the simulator, or of a cancelled search.
    pub fn verify(
        &self,
        before: &Hypothesis,
        after: &Hypothesis,
        wrong: Option<&Hypothesis>,
        known: Option<&Verification>,
        on_round: OnRound<'_>,
    ) -> Result<(Verification, [Prediction; 2]), FinderError> {
        let first = self.predict(before, on_round)?;
        let second = self.predict(after, on_round)?;
        let wrong_effect = match wrong.map(|wrong| (wrong, self.predict(wrong, on_round))) {
            // The wrong effect is a bar for comparison alone: the search does without it if it cannot be simulated here.
            None | Some((_, Err(FinderError::NoFit(_) | FinderError::Simulator(_)))) => None,
            Some((wrong, prediction)) => Some((wrong.names().join(" + "), prediction?.score)),
        };
        let floor_mm = self.floor(after, &second, on_round)?;
        let closed = |before: f64, after: f64| share_closed(before, after, floor_mm?);
        let (p_value, null_sets) = match known.filter(|known| known.p_value.is_some()) {
            Some(known) => (known.p_value, known.null_sets),
            None => self.p_value(after, &second, on_round)?,
        };
        let gap_closed = closed(first.score.rmse_mm, second.score.rmse_mm);
        let share_explained = share_explained(&first.fits, &second.fits);
        // If the distances differ from the floor by chance alone, the closed share is a ratio of two noises.
        let is_gap = share_explained.is_some() || p_value.is_some_and(|p| p <= self.settings.repaired_level);
        let verification = Verification {
            episodes: self.episodes.len(),
            selects: true,
            before: first.score,
            after: second.score,
            floor_mm,
            gap_closed,
            interval: gap_closed.filter(|_| is_gap).and_then(|_| {
                closed_interval(&first.offsets, &second.offsets, &closed, seed::rng(self.settings.seed, STREAMS[2]))
            }),
            p_value,
            null_sets,
            draws_left_out: first.left_out + second.left_out,
            share_explained,
            log_likelihood_gain: 0.5 * (first.cost() - second.cost()),
            wrong_effect,
            black_box_mm: self.black_box(before, &first),
        };
        Ok((verification, [first, second]))
    }

    /// Problem of one held-out episode, with the shared unknowns held.
    fn problem_of<'c>(&'c self, hypothesis: &Hypothesis, episode: &'c MeasuredEpisode) -> Problem<'c> {
        let unknowns = hypothesis.unknowns.for_episodes(1);
        Problem { episodes: std::slice::from_ref(episode), unknowns, is_shared_held: true, ..*self.problem }
    }

    /// Episode with its fit. If the model has a fidelity correction, so has the episode.
    pub(crate) fn fitted(
        &self,
        episode: &MeasuredEpisode,
        hypothesis: &Hypothesis,
        on_round: OnRound<'_>,
    ) -> Result<(MeasuredEpisode, Fit), FinderError> {
        let fit = self.fit(episode, hypothesis, on_round)?;
        match self.settings.finer_fidelity {
            Some(finer) if hypothesis.correction == FidelityCorrection::Applied => {
                let own = corrected_fit(&self.problem_of(hypothesis, episode), fit, finer, on_round)?;
                let episode = own.episodes.into_iter().next();
                Ok((episode.ok_or_else(|| FinderError::NoFit("no episode was left".into()))?, own.fit))
            }
            _ => Ok((episode.clone(), fit)),
        }
    }

    /// Best fit of the episode's own unknowns.
    fn fit(
        &self,
        episode: &MeasuredEpisode,
        hypothesis: &Hypothesis,
        on_round: OnRound<'_>,
    ) -> Result<Fit, FinderError> {
        let problem = self.problem_of(hypothesis, episode);
        let middle = problem.unknowns.shared_from(&hypothesis.unknowns, &hypothesis.fit.point);
        let mut rng = seed::rng(self.settings.seed, STREAMS[3]);
        let mut point = |number: usize| {
            let mut point = middle.clone();
            for (i, unknown) in problem.unknowns.list().iter().enumerate() {
                if number > 0 && unknown.scope == Scope::PerEpisode {
                    // Point 0 is the middle of the priors; the others are draws.
                    point[problem.unknowns.column(i, 0)] = rng.random();
                }
            }
            point
        };
        Ok(problem.best_of((0..DRAWS).map(&mut point).collect(), STARTS.min(self.settings.starts), on_round)?)
    }

    /// Predictions of the held-out episodes.
    ///
    /// # Errors
    /// As [`Verifier::verify`].
    pub fn predict(&self, hypothesis: &Hypothesis, on_round: OnRound<'_>) -> Result<Prediction, FinderError> {
        let mut prediction = Prediction {
            tracks: Vec::new(),
            offsets: Vec::new(),
            draws: Vec::new(),
            left_out: 0,
            score: Score { rmse_mm: 0.0, energy_mm: None },
            fits: Vec::new(),
            episodes: Vec::new(),
        };
        let mut energies = Vec::new();
        let known = hypothesis.posterior().ok_or_else(FinderError::curvature)?;
        for (index, episode) in self.episodes.iter().enumerate() {
            let (episode, fit) = self.fitted(episode, hypothesis, on_round)?;
            let (draws, left_out) = self.draws(&episode, hypothesis, &known, &fit, (STREAMS[0], index), PREDICTIONS)?;
            prediction.left_out += left_out;
            energies.extend(energy_score_mm(&episode, &draws, self.camera));
            prediction.offsets.push(episode.offsets_mm(&fit.tracks[0], self.camera));
            prediction.tracks.push(fit.tracks[0].clone());
            prediction.draws.push(draws);
            prediction.fits.push(fit);
            prediction.episodes.push(episode);
        }
        prediction.score = Score {
            rmse_mm: rmse_mm(prediction.offsets.iter().flatten()),
            energy_mm: (!energies.is_empty()).then(|| mean(&energies)),
        };
        Ok(prediction)
    }

    /// Draws of the predicted episode with noise: shared unknowns from `shared`, the others around their fit. The number of
    /// draws that could not be simulated comes with them.
    fn draws(
        &self,
        episode: &MeasuredEpisode,
        hypothesis: &Hypothesis,
        shared: &Laplace,
        held: &Fit,
        (stream, index): (u64, usize),
        count: usize,
    ) -> Result<(Vec<Track>, usize), FinderError> {
        let own = Laplace::of(held).ok_or_else(FinderError::curvature)?;
        let problem = self.problem_of(hypothesis, episode);
        let mut rng = seed::rng(seed::derive(self.settings.seed, stream), index as u64);
        let Draws { tracks, left_out } = Draws::of(&problem, count, || {
            let point = own.draw(&mut rng);
            with_shared(&problem, hypothesis, point, &shared.draw(&mut rng))
        });
        Ok((tracks.iter().map(|tracks| episode.measure(&tracks[0], &mut rng)).collect(), left_out))
    }

    /// p-value of the model's residual energy among null sets simulated from its posterior. In a null set all held-out
    /// episodes have the same draw of the shared unknowns. As for the measured data, a fit holds the shared unknowns of
    /// the fitted episodes, so that its offset from the draw counts as noise. None if fewer than half of the null sets
    /// can be simulated. The number of null sets comes with it.
    fn p_value(
        &self,
        hypothesis: &Hypothesis,
        prediction: &Prediction,
        on_round: OnRound<'_>,
    ) -> Result<(Option<f64>, usize), FinderError> {
        let known = Laplace::of(&hypothesis.fit).ok_or_else(FinderError::curvature)?;
        let seeds = seed::derive(self.settings.seed, STREAMS[4]);
        let mut rng = seed::rng(seeds, 0);
        let shared: Vec<Vec<f64>> = (0..TESTED).map(|_| known.draw(&mut rng)).collect();
        let mut null = vec![Some(0.0); TESTED];
        for (index, (episode, fit)) in prediction.episodes.iter().zip(&prediction.fits).enumerate() {
            let own = Laplace::of(fit).ok_or_else(FinderError::curvature)?;
            let problem = self.problem_of(hypothesis, episode);
            let mut rng = seed::rng(seeds, 1 + index as u64);
            for (shared, sums) in shared.chunks(SLICE).zip(null.chunks_mut(SLICE)) {
                let draw = |whole: &Vec<f64>| with_shared(&problem, hypothesis, own.draw(&mut rng), whole);
                let points: Vec<Vec<f64>> = shared.iter().map(draw).collect();
                let tracks =
                    problem.tracks_each(&points).into_iter().map(|t| t.ok().filter(|t| !t[0].frames.is_empty()));
                let measured: Vec<Option<Track>> = tracks.map(|t| Some(episode.measure(&t?[0], &mut rng))).collect();
                let costs = refitted(&problem, fit, measured, on_round)?;
                sums.iter_mut().zip(costs).for_each(|(sum, cost)| *sum = sum.zip(cost).map(|(a, b)| a + b));
            }
        }
        let null: Vec<f64> = null.into_iter().flatten().collect();
        // Failed sets are not random: they may be the extreme draws.
        let (count, is_enough) = (null.len(), 2 * null.len() >= TESTED);
        Ok((is_enough.then(|| p_value(prediction.cost(), null.into_iter())), count))
    }

    /// Noise floor: root mean square distance of repeats simulated from the model, after a fit of their own unknowns; none if
    /// no repeat can be simulated and fitted.
    fn floor(
        &self,
        hypothesis: &Hypothesis,
        prediction: &Prediction,
        on_round: OnRound<'_>,
    ) -> Result<Option<f64>, FinderError> {
        let mut offsets: Vec<Offset> = Vec::new();
        // Repeats share one condition, so that the spread between conditions does not count.
        let known = Laplace::of(&hypothesis.fit).ok_or_else(FinderError::curvature)?;
        for (index, (episode, fit)) in prediction.episodes.iter().zip(&prediction.fits).enumerate() {
            let problem = self.problem_of(hypothesis, episode);
            let repeats = self.draws(episode, hypothesis, &known, fit, (STREAMS[1], index), REPEATS)?.0;
            let start = |track: &Track| Start { point: fit.point.clone(), tracks: vec![track.clone()] };
            let fits = match problem.fit(repeats.iter().map(start).collect(), on_round) {
                // The floor is that of the other episodes.
                Err(FitError::NoFit(_)) => continue,
                fits => fits?,
            };
            for (repeat, fit) in repeats.iter().zip(fits) {
                offsets
                    .extend(fit.into_iter().flat_map(|f| offsets_mm(repeat, &f.tracks[0], episode.order, self.camera)));
            }
        }
        let is_seen = offsets.iter().any(Option::is_some);
        Ok(is_seen.then(|| rmse_mm(offsets.iter())))
    }

    fn black_box(&self, before: &Hypothesis, prediction: &Prediction) -> Option<f64> {
        let fitted = self.problem.episodes.iter().zip(&before.fit.tracks);
        let learnt: Vec<(&Track, Vec<Offset>)> =
            fitted.map(|(episode, track)| (track, episode.offsets_mm(track, self.camera))).collect();
        let regression = BlackBox::learn(&learnt)?;
        let left: Vec<Offset> = prediction
            .tracks
            .iter()
            .zip(&prediction.offsets)
            .flat_map(|(track, offsets)| {
                let predicted = regression.predict(track);
                let last = predicted.len().saturating_sub(1);
                offsets
                    .iter()
                    .enumerate()
                    .map(move |(i, o)| {
                        let (o, t) = (o.as_ref()?, predicted.get(i.min(last))?);
                        Some(std::array::from_fn(|k| o[k] - t[k]))
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        Some(rmse_mm(left.iter()))
    }
}

/// Point with the shared unknowns of the model's point `whole`.
fn with_shared(problem: &Problem<'_>, hypothesis: &Hypothesis, mut point: Vec<f64>, whole: &[f64]) -> Vec<f64> {
    for (i, unknown) in problem.unknowns.list().iter().enumerate() {
        if unknown.scope == Scope::Shared {
            point[problem.unknowns.column(i, 0)] = whole[hypothesis.unknowns.column(i, 0)];
        }
    }
    point
}

/// Lowest costs of these tracks near `fit`, in their order; none for a track that is missing or cannot be fitted.
fn refitted(
    problem: &Problem<'_>,
    fit: &Fit,
    measured: Vec<Option<Track>>,
    on_round: OnRound<'_>,
) -> Result<Vec<Option<f64>>, FinderError> {
    let simulated =
        |track| SimulatedSet { point: fit.point.clone(), tracks: fit.tracks.clone(), measured: vec![track] };
    let is_there: Vec<bool> = measured.iter().map(Option::is_some).collect();
    let sets: Vec<SimulatedSet> = measured.into_iter().flatten().map(simulated).collect();
    if sets.is_empty() {
        return Ok(vec![None; is_there.len()]);
    }
    let mut fits = match problem.refit(fit, sets, on_round) {
        Err(FitError::NoFit(_)) => return Ok(vec![None; is_there.len()]),
        fits => fits?.into_iter(),
    };
    let cost = |is_there: bool| if is_there { fits.next().flatten().map(|fit| fit.cost) } else { None };
    Ok(is_there.into_iter().map(cost).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::{Effort, Evidence};
    use catenary_core::Model;
    use std::ops::ControlFlow;
    use track_fit::fitting::best_fit;
    use track_fit::toy::{self, Toy};

    const TRUTH: [f64; 2] = [0.25, 2e4];

    fn go_on() -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// Model that draws friction anew for each episode.
    fn model() -> Model {
        let mut model = Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml")).unwrap();
        model.effects.retain(|e| e.name == "table_friction");
        model.camera.position_jitter_m = 0.0;
        model
    }

    /// Held-out p-value of the present model, fitted to the first frames of measurement `number`. A short fit leaves
    /// the shared unknowns uncertain, which the null sets must count.
    fn tested(number: u64, effects: &[(&str, f64)]) -> f64 {
        let (toy, model) = (Toy { gain: 0.3 }, model());
        let settings = Settings { draws: 40, starts: 2, seed: number, ..Settings::default() };
        let measured = |friction, effects: &[(&str, f64)], stream| {
            let all: Vec<(&str, f64)> = [("table_friction", friction)].iter().chain(effects).copied().collect();
            toy::episode(&toy, TRUTH, &all).measured_anew(&mut seed::rng(41, 3 * number + stream))
        };
        let episodes = [measured(0.4, &[], 0).beginning(0.3)];
        let held_out = [measured(0.5, effects, 1), measured(0.45, effects, 2)];
        let problem = Problem::of(&model, &episodes, &toy, 40);
        let base = Hypothesis {
            candidates: Vec::new(),
            unknowns: problem.unknowns.clone(),
            episodes: None,
            correction: FidelityCorrection::Rejected,
            fit: best_fit(&problem, Vec::new(), &settings.of_fits(), &mut go_on).unwrap(),
            evidence: Evidence { alone: 0.0, with: Vec::new() },
            effort: Effort::Searched,
            spread: Vec::new(),
        };
        let camera = &model.camera.view;
        let verifier = Verifier { problem: &problem, episodes: &held_out, camera, settings: &settings };
        let prediction = verifier.predict(&base, &mut go_on).unwrap();
        verifier.p_value(&base, &prediction, &mut go_on).unwrap().0.unwrap()
    }

    /// p-values count the fit's own uncertainty once for all episodes, so that they are uniform: a tenth lies under
    /// 0.1. In 100 of them that number is 3 to 19, except once in 300 times.
    #[test]
    fn held_out_p_values_are_uniform_if_the_model_holds() {
        let p: Vec<f64> = (0..100).map(|number| tested(number, &[])).collect();
        let small = p.iter().filter(|p| **p <= 0.1).count();
        let large = p.iter().filter(|p| **p > 0.9).count();
        assert!((3..=19).contains(&small) && (3..=19).contains(&large), "{small} {large}");
        assert_eq!(tested(1, &[("tip_mass_kg", 0.5)]), 0.005, "it is another object");
    }
}
