//! Sequential inference: iterations of drawing thetas, simulating them, and training on all tracks so far.
//!
//! ```
//! use bayes_sim::sequential::{Observed, Sequential};
//! use bayes_sim::Settings;
//! use catenary_core::{Drive, Fidelity, Frame, Parameter, ParameterSpace, Prior, SimulationRequest, seed};
//! use catenary_core::{Simulator, SimulatorError, Track, simulator::StartShape, track::End};
//! use rand::RngExt;
//! use std::ops::ControlFlow;
//!
//! /// A straight bar whose slope is the parameter, seen with noise.
//! struct Bar;
//!
//! impl Simulator for Bar {
//!     fn simulate(&self, request: &SimulationRequest) -> Result<Vec<Track>, SimulatorError> {
//!         let track = |(episode, theta): (u64, &Vec<f64>)| {
//!             let mut rng = seed::rng(request.seed, episode);
//!             let dlo = [0.0, 0.2, 0.4, 0.6].map(|x| [x, theta[0] * x + 0.02 * (rng.random::<f64>() - 0.5)]);
//!             let frame = Frame { time_s: 0.0, dlo, target: [0.0; 2], eef: [0.0; 3], action: [0.0; 2], wrench: None };
//!             Track { frames: vec![frame], end: End::Complete }
//!         };
//!         Ok((request.first_episode..).zip(&request.thetas).map(track).collect())
//!     }
//! }
//!
//! let slope = Parameter { name: "slope".into(), prior: Prior::Uniform { low: -1.0, high: 1.0 } };
//! let space = ParameterSpace::new(vec![slope])?;
//! let template = SimulationRequest {
//!     thetas: vec![vec![0.3]], effects: vec![], drive: Drive::Actions(vec![]), start: StartShape::HangingAtRest,
//!     frame_times_s: vec![], target_m: None, fidelity: Fidelity::Fast, seed: 1, first_episode: 0, noise: true,
//! };
//! let measured = Bar.simulate(&template)?.remove(0);
//! let settings = Settings { hidden: vec![16], ensemble: 1, ..Settings::default() };
//! let observed = vec![Observed { track: &measured, template, frames: 1 }];
//! let mut inference = Sequential::new(&space, observed, &settings, 0)?;
//! let mut posterior = None;
//! for _ in 0..3 {
//!     posterior = Some(inference.step(&Bar, &mut |_| ControlFlow::Continue(()))?.1);
//! }
//! let marginal = &posterior.expect("three iterations").marginals()?[0];
//! assert!((marginal.mean - 0.3).abs() < 0.1 && marginal.sd < 0.15);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod iteration;
mod progress;
mod proposal;
mod region;
mod request;
mod resume;
mod state;
mod support;
#[cfg(test)]
pub(crate) mod tests;

pub use iteration::Iteration;
pub use progress::{OnProgress, Progress};
pub use proposal::{Drawn, Proposal, balance_weights, effective_sample_size};
pub use region::Region;
pub use request::{Observed, request};
pub use state::State;
pub use support::SupportMove;
pub(crate) use support::{DRAWS, Side, pressed};

use crate::embedding::{InputError, TrackInput};
use crate::error::InferenceError;
use crate::network::{Ensemble, Epoch, IntervalFactors, Network, Outcome, Samples, Shape, Training, TrainingError};
use crate::prior_support::PriorSupport;
use crate::settings::{LEAST_TRACKS, Settings};
use catenary_core::{Mixture, ParameterSpace, Posterior, SimulationRequest, Simulator, Track, seed};

/// Number of simulations in one request. The caller may stop between two requests.
pub(crate) const PART: usize = 64;

/// Networks, tracks and proposals of an inference, after any number of iterations.
pub struct Sequential<'a> {
    /// Parameters with the support of the first iteration.
    space: &'a ParameterSpace,
    settings: &'a Settings,
    /// Joined tracks of all measured episodes.
    observed: TrackInput,
    /// Request that reproduces each measured episode, and the largest number of frames of its tracks.
    episodes: Vec<(SimulationRequest, usize)>,
    state: State,
    /// Proposals of all iterations.
    proposals: Vec<Drawn>,
    /// Reason for which the last unusable track was refused.
    refused: Option<String>,
}

/// Adds the next track of a theta, unless it or an earlier track of the theta is unusable.
fn add(inputs: &mut Result<Vec<TrackInput>, InputError>, track: &Track, frames: usize) {
    let Ok(list) = inputs else { return };
    match TrackInput::new(track, frames) {
        Ok(input) => list.push(input),
        Err(why) => *inputs = Err(why),
    }
}

/// Indices of the samples on which an iteration with `proposal` trains: those in its support.
fn covered(samples: &Samples, proposal: &Drawn) -> Vec<usize> {
    (0..samples.len()).filter(|&i| proposal.covers(samples.theta(i))).collect()
}

/// Seed of the simulations of one measured episode, derived from the seed of all.
pub(crate) fn episode_seed(seed: u64, episode: usize) -> u64 {
    // The first episode keeps the seed: its simulations are the same alone and among several.
    if episode == 0 { seed } else { seed::derive(seed, episode as u64) }
}

/// Random streams derived from the seed of the settings.
#[derive(Clone, Copy)]
enum Stream {
    Thetas = 1,
    Simulator = 2,
    Proposal = 3,
    HeldOut = 4,
    Training = 5,
    Support = 6,
}

impl<'a> Sequential<'a> {
    /// Prepares an inference of the parameters of `space` from the episodes `observed` of one object. The simulator
    /// reproduces all episodes at each theta, and the networks get their tracks side by side. `fingerprint` identifies the
    /// inference ([`crate::fingerprint()`]): only a state with an equal one is resumed.
    ///
    /// # Errors
    /// [`InferenceError::Setting`] or [`InferenceError::Observation`].
    pub fn new(
        space: &'a ParameterSpace,
        observed: Vec<Observed<'_>>,
        settings: &'a Settings,
        fingerprint: u64,
    ) -> Result<Self, InferenceError> {
        settings.check()?;
        support::check(settings.prior_support, space)?;
        let inputs = observed.iter().map(|o| TrackInput::new(o.track, o.frames)).collect::<Result<Vec<_>, _>>();
        let episodes: Vec<_> = observed.into_iter().map(|o| (o.template, o.frames)).collect();
        let observed = TrackInput::join(inputs.map_err(InferenceError::Observation)?);
        let samples = Samples::new(observed.frames(), space.dimension());
        let state = State::new(fingerprint, samples);
        Ok(Self { space, settings, observed, episodes, state, proposals: Vec::new(), refused: None })
    }

    fn seed(&self, stream: Stream, index: usize) -> u64 {
        seed::derive(seed::derive(self.settings.seed, stream as u64), index as u64)
    }

    /// Networks after the last iteration.
    pub fn networks(&self) -> &[Network] {
        self.state.ensemble.networks()
    }

    /// Proposal of the last iteration, over the unit coordinates of [`Self::space`].
    pub fn proposal(&self) -> Option<&Proposal> {
        self.proposals.last().map(Drawn::proposal)
    }

    /// Parameters with the support of the last iteration, over whose unit coordinates its posterior is.
    pub fn space(&self) -> &ParameterSpace {
        self.space_of(self.state.iterations.len())
    }

    /// Parameters with the support of iteration `number`, from 1.
    fn space_of(&self, number: usize) -> &ParameterSpace {
        number.checked_sub(2).and_then(|i| self.state.supports.get(i)).unwrap_or(self.space)
    }

    /// Samples with usable tracks so far.
    pub fn samples(&self) -> &Samples {
        &self.state.samples
    }

    /// State after the last iteration.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Posterior after the last iteration; none before the first one.
    pub fn posterior(&self) -> Option<Posterior> {
        let mixture = self.state.newest()?.clone();
        Some(Posterior { parameters: self.space().clone(), mixture })
    }

    /// Measured tracks as the input of the networks.
    pub fn observed(&self) -> &TrackInput {
        &self.observed
    }

    /// Posterior of the last iteration, widened until its 90 % intervals hold their share of the simulations that the
    /// networks held out, and the factors. None before the first iteration.
    ///
    /// # Errors
    /// [`InferenceError::Posterior`] if the widened mixture is invalid.
    pub fn calibrated(&self) -> Result<Option<(Posterior, IntervalFactors)>, InferenceError> {
        let Some(newest) = self.proposals.last() else { return Ok(None) };
        let iteration = self.proposals.len();
        let (indices, weights) = self.training_samples(newest);
        let data = self.state.samples.gather(&indices);
        let training = self.training(iteration, &indices, &data, &weights);
        let factors = self.state.ensemble.interval_factors(&training, self.settings.held_out_share);
        let widened = self.state.ensemble.widened_mixture(&self.observed_batch(), &factors.factors);
        let mixture = widened.map_err(|reason| InferenceError::Posterior { iteration, reason })?;
        // A support that has moved since is that of the networks.
        Ok(Some((Posterior { parameters: self.space_of(iteration + 1).clone(), mixture }, factors)))
    }

    /// Runs one iteration: draws thetas from the proposal, simulates them with `simulator`, and trains the networks. Returns
    /// its account and the new posterior.
    ///
    /// # Errors
    /// [`InferenceError`] with the number of the iteration; [`InferenceError::Cancelled`] if `on_progress` breaks.
    pub fn step(
        &mut self,
        simulator: &dyn Simulator,
        on_progress: OnProgress<'_>,
    ) -> Result<(Iteration, Posterior), InferenceError> {
        let number = self.proposals.len() + 1;
        let proposal = self.next_proposal(number, &self.proposals, &self.state.posteriors)?;
        self.simulate(number, proposal, simulator, on_progress)?;
        let newest = &self.proposals[number - 1];
        let proposal_volume = newest.volume();
        let (indices, weights) = self.training_samples(newest);
        if indices.len() < LEAST_TRACKS {
            return Err(InferenceError::TooFewTracks {
                iteration: number,
                expected: LEAST_TRACKS,
                got: indices.len(),
                because: self.refused.as_ref().map_or(String::new(), |why| format!("; the last refused one: {why}")),
            });
        }
        let data = self.state.samples.gather(&indices);
        let outcome = self.train(number, &indices, &data, &weights, on_progress)?;
        let mixture = self.mixture().map_err(|reason| InferenceError::Posterior { iteration: number, reason })?;
        let posterior = Posterior { parameters: self.space_of(number).clone(), mixture };
        let (next, moves) = self.next_support(number, &posterior, simulator);
        let iteration = Iteration {
            iteration: number,
            simulations: self.state.simulations,
            tracks: indices.len(),
            unusable: self.state.simulations - self.state.samples.len(),
            loss: outcome.held_out_loss,
            effective_sample_size: effective_sample_size(&weights),
            proposal_volume,
            epochs: outcome.epochs,
            moves,
        };
        self.state.iterations.push(iteration.clone());
        self.state.posteriors.push(posterior.mixture.clone());
        if let Some(next) = next {
            self.follow(&posterior.parameters, &next);
            self.state.supports.push(next);
        }
        let (of, state) = (self.settings.iterations, &self.state);
        let progress = Progress::Iteration { iteration: &iteration, of, posterior: &posterior, state };
        if on_progress(&progress).is_break() {
            return Err(InferenceError::Cancelled { simulations: self.state.simulations });
        }
        Ok((iteration, posterior))
    }

    /// Proposal of iteration `number`: the prior in the first one. `proposals` and `posteriors` are those of the iterations
    /// before, the proposals over the unit coordinates of this one.
    fn next_proposal(
        &self,
        number: usize,
        proposals: &[Drawn],
        posteriors: &[Mixture],
    ) -> Result<Proposal, InferenceError> {
        let Some((last, mixture)) = proposals.last().zip(posteriors.last()) else { return Ok(Proposal::Prior) };
        let mut rng = seed::rng(self.seed(Stream::Proposal, number), 0);
        let kind = self.settings.proposal;
        match support::map(self.space_of(number - 1), self.space_of(number)) {
            None => Proposal::next(kind, mixture, last, number, &mut rng),
            Some(map) if map.added() > support::MOST_ADDED => Ok(Proposal::Prior),
            Some(map) => {
                let moved = map.mixture(mixture);
                let moved = moved.map_err(|reason| InferenceError::Posterior { iteration: number, reason })?;
                Proposal::next(kind, &moved, last, number, &mut rng)
            }
        }
    }

    /// Support of the iteration after `number`, whose posterior is `newest`, and its moves. None if the setting fixes it.
    fn next_support(
        &self,
        number: usize,
        newest: &Posterior,
        simulator: &dyn Simulator,
    ) -> (Option<ParameterSpace>, Vec<SupportMove>) {
        let PriorSupport::Adaptive(rule) = self.settings.prior_support else { return (None, Vec::new()) };
        if number > support::last_move(self.settings.iterations) {
            return (Some(newest.parameters.clone()), Vec::new());
        }
        let before = self.state.posteriors.last();
        let before = before.map(|mixture| support::Placed { space: self.space_of(number - 1), mixture });
        let newest = support::Placed { space: &newest.parameters, mixture: &newest.mixture };
        let mut rng = seed::rng(self.seed(Stream::Support, number), 0);
        let (space, moves) =
            support::moved(rule, number, &newest, before.as_ref(), &|name| simulator.range_of(name), &mut rng);
        (Some(space), moves)
    }

    /// Converts samples, networks and proposals from the unit coordinates of `from` to those of `to`.
    fn follow(&mut self, from: &ParameterSpace, to: &ParameterSpace) {
        if let Some(map) = support::map(from, to) {
            self.state.samples.map_thetas(&map);
            self.state.ensemble.map_thetas(&map);
            self.proposals.iter_mut().for_each(|p| p.follow(&map));
        }
    }

    /// Draws thetas, simulates them and keeps the usable tracks. Leaving out the others introduces no bias: the networks learn
    /// the posterior given that tracks are usable, and the measured tracks are usable.
    fn simulate(
        &mut self,
        number: usize,
        proposal: Proposal,
        simulator: &dyn Simulator,
        on_progress: OnProgress<'_>,
    ) -> Result<(), InferenceError> {
        let mut rng = seed::rng(self.seed(Stream::Thetas, number), 0);
        let d = self.space.dimension();
        let count = self.settings.simulations;
        let u = (0..count).map(|_| proposal.sample(d, number, &mut rng)).collect::<Result<Vec<_>, _>>()?;
        let space = self.space_of(number);
        let thetas: Vec<Vec<f64>> = u.iter().map(|u| space.from_unit(u)).collect();
        let seed = self.seed(Stream::Simulator, number);
        for (part, u) in u.chunks(PART).enumerate() {
            let from = part * PART;
            let mut joined: Vec<Result<Vec<TrackInput>, InputError>> = vec![Ok(Vec::new()); u.len()];
            for (episode, (template, frames)) in self.episodes.iter().enumerate() {
                let request = SimulationRequest {
                    thetas: thetas[from..from + u.len()].to_vec(),
                    seed: episode_seed(seed, episode),
                    first_episode: from as u64,
                    ..template.clone()
                };
                let tracks = simulator.simulate(&request)?;
                if tracks.len() != u.len() {
                    return Err(InferenceError::TrackCount { expected: u.len(), got: tracks.len() });
                }
                for (slot, track) in joined.iter_mut().zip(&tracks) {
                    add(slot, track, *frames);
                }
                // A theta counts as simulated once all its episodes are.
                let simulations = self.state.simulations + u.len() * usize::from(episode + 1 == self.episodes.len());
                if on_progress(&Progress::Working { iteration: number, simulations }).is_break() {
                    return Err(InferenceError::Cancelled { simulations });
                }
            }
            self.state.simulations += u.len();
            for (u, inputs) in u.iter().zip(joined) {
                match inputs {
                    Ok(inputs) => self.state.samples.push(&TrackInput::join(inputs), u),
                    Err(why) => self.refused = Some(why.to_string()),
                }
            }
        }
        self.proposals.push(Drawn::new(proposal, count));
        Ok(())
    }

    /// Trains the networks on `data`, the samples at `indices`.
    fn train(
        &mut self,
        number: usize,
        indices: &[usize],
        data: &Samples,
        weights: &[f64],
        on_progress: OnProgress<'_>,
    ) -> Result<Outcome, InferenceError> {
        let simulations = self.state.simulations;
        let mut listen = |network: usize, epoch: Option<Epoch>| match epoch {
            Some(epoch) => on_progress(&Progress::Epoch { iteration: number, network, epoch }),
            None => on_progress(&Progress::Working { iteration: number, simulations }),
        };
        let before = Some(&self.state.ensemble).filter(|_| self.settings.warm_start);
        let training = self.training(number, indices, data, weights);
        let (ensemble, outcome) =
            Ensemble::train(&Shape::of_samples(data, self.settings), self.settings, before, training, &mut listen)
                .map_err(|source| match source {
                    TrainingError::Stopped => InferenceError::Cancelled { simulations },
                    reason => InferenceError::Training { iteration: number, reason },
                })?;
        self.state.ensemble = ensemble;
        Ok(outcome)
    }

    /// Indices of the samples of a training with the proposal `newest`, and their weights.
    fn training_samples(&self, newest: &Drawn) -> (Vec<usize>, Vec<f64>) {
        let indices = covered(&self.state.samples, newest);
        let weights = balance_weights(indices.iter().map(|&i| self.state.samples.theta(i)), &self.proposals);
        (indices, weights)
    }

    /// Training data of iteration `number`: the samples `data` at `indices` with their `weights`.
    fn training<'b>(&self, number: usize, indices: &'b [usize], data: &'b Samples, weights: &'b [f64]) -> Training<'b> {
        let seed = self.seed(Stream::Training, number);
        let held_out_seed = seed::derive(self.settings.seed, Stream::HeldOut as u64);
        Training { data, weights, split_keys: indices, seed, held_out_seed }
    }

    /// Mean of the networks' mixtures at the measured tracks.
    fn mixture(&self) -> Result<Mixture, catenary_core::mixture::MixtureError> {
        self.state.ensemble.mixture(&self.observed_batch())
    }

    /// Measured tracks as a batch of one sample.
    fn observed_batch(&self) -> Samples {
        let mut batch = Samples::new(self.observed.frames(), self.space.dimension());
        // A sample needs a theta, which the mixture does not depend on.
        batch.push(&self.observed, &vec![0.5; self.space.dimension()]);
        batch
    }
}
