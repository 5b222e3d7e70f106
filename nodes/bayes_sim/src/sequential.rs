//! Algorithm 1: iterations of simulating, training on all tracks so far, and drawing anew from what was learnt.

mod proposal;
mod region;
mod request;
mod state;
#[cfg(test)]
pub(crate) mod tests;

pub use proposal::{Proposal, balance_weights, effective_sample_size};
pub use region::Region;
pub use request::{Observed, request};
pub use state::{State, StateError};

use crate::embedding::{InputError, TrackInput};
use crate::error::InferenceError;
use crate::network::{Ensemble, Epoch, Network, Outcome, Samples, Shape, Training, TrainingError};
use crate::settings::{LEAST_TRACKS, Settings};
use catenary_core::{Mixture, ParameterSpace, Posterior, SimulationRequest, Simulator, Track, seed};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Simulations that are asked for at once: between two parts the caller may stop.
pub(crate) const PART: usize = 64;

/// What one iteration did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Iteration {
    /// Number, from 1.
    pub iteration: usize,
    /// Thetas simulated so far, each in every measured episode.
    pub simulations: usize,
    /// Thetas whose tracks the networks were trained on, held-out ones included.
    pub tracks: usize,
    /// Thetas so far with an unusable track.
    pub unusable: usize,
    /// Held-out negative log density in nat, unit coordinates, of the widened mixtures truncated to the prior's support; mean over the
    /// networks.
    pub loss: f64,
    /// Effective sample size of the importance weights.
    pub effective_sample_size: f64,
    /// Share of the prior's volume that thetas were drawn from.
    pub proposal_volume: f64,
    /// Passes over the tracks, summed over the networks.
    pub epochs: usize,
}

/// What the caller hears while inference runs.
#[derive(Debug)]
pub enum Progress<'a> {
    /// A part of the simulations is done, or of a pass over the tracks: a chance to stop.
    Working {
        /// Iteration, from 1.
        iteration: usize,
        /// Simulations run so far.
        simulations: usize,
    },
    /// A network made a pass over the tracks.
    Epoch {
        /// Iteration, from 1.
        iteration: usize,
        /// Which network, from 0.
        network: usize,
        /// How far it is.
        epoch: Epoch,
    },
    /// An iteration ended.
    Iteration {
        /// What it did.
        iteration: &'a Iteration,
        /// Iterations in all.
        of: usize,
        /// The present estimate.
        posterior: &'a Posterior,
        /// What is needed to go on from here.
        state: &'a State,
    },
}

/// Called with each [`Progress`]; `Break` cancels the inference.
pub type OnProgress<'a> = &'a mut dyn FnMut(&Progress<'_>) -> ControlFlow<()>;

/// Networks, tracks and proposals of an inference, after any number of iterations.
pub struct Sequential<'a> {
    space: &'a ParameterSpace,
    settings: &'a Settings,
    /// All measured episodes, joined.
    observed: TrackInput,
    /// What reproduces each, and its greatest number of frames.
    episodes: Vec<(SimulationRequest, usize)>,
    state: State,
    /// With the number of draws of each, unusable ones included.
    proposals: Vec<(Proposal, usize)>,
    refused: Option<String>,
}

/// Adds a theta's next track, unless it or one before it is unusable.
fn add(inputs: &mut Result<Vec<TrackInput>, InputError>, track: &Track, frames: usize) {
    let Ok(list) = inputs else { return };
    match TrackInput::new(track, frames) {
        Ok(input) => list.push(input),
        Err(why) => *inputs = Err(why),
    }
}

/// Those of `samples` that `proposal` could have given: what an iteration trains on.
fn covered(samples: &Samples, proposal: &Proposal) -> Vec<usize> {
    (0..samples.len()).filter(|&i| proposal.covers(samples.theta(i))).collect()
}

/// Seed of the simulations of one measured episode, from that of all.
pub(crate) fn episode_seed(seed: u64, episode: usize) -> u64 {
    if episode == 0 { seed } else { seed::derive(seed, episode as u64) }
}

/// Streams of random numbers, derived from the seed of the settings.
#[derive(Clone, Copy)]
enum Stream {
    Thetas = 1,
    Simulator = 2,
    Proposal = 3,
    HeldOut = 4,
    Training = 5,
}

impl<'a> Sequential<'a> {
    /// Prepares an inference of the parameters of `space` from the episodes `observed`, which one theta gave: for each
    /// theta the simulator reproduces all of them, and the networks see their tracks side by side. `question` is a number that
    /// stands for all that the outcome depends on: a state is resumed where it is the same.
    pub fn new(
        space: &'a ParameterSpace,
        observed: Vec<Observed<'_>>,
        settings: &'a Settings,
        question: u64,
    ) -> Result<Self, InferenceError> {
        settings.check()?;
        let inputs = observed.iter().map(|o| TrackInput::new(o.track, o.frames)).collect::<Result<Vec<_>, _>>();
        let episodes: Vec<_> = observed.into_iter().map(|o| (o.template, o.frames)).collect();
        let observed = TrackInput::join(inputs.map_err(InferenceError::Observation)?);
        let samples = Samples::new(observed.frames(), space.dimension());
        let state = State::new(question, samples);
        Ok(Self { space, settings, observed, episodes, state, proposals: Vec::new(), refused: None })
    }

    fn seed(&self, stream: Stream, index: usize) -> u64 {
        seed::derive(seed::derive(self.settings.seed, stream as u64), index as u64)
    }

    /// The networks.
    pub fn networks(&self) -> &[Network] {
        self.state.ensemble.networks()
    }

    /// The newest proposal.
    pub fn proposal(&self) -> Option<&Proposal> {
        self.proposals.last().map(|(p, _)| p)
    }

    /// All usable tracks so far.
    pub fn samples(&self) -> &Samples {
        &self.state.samples
    }

    /// All that the iterations so far have left behind.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The measured track as the networks see it.
    pub fn observed(&self) -> &TrackInput {
        &self.observed
    }

    /// One iteration: draws thetas from the newest posterior, simulates them with `simulator`, trains, and returns what was
    /// done and the new posterior.
    pub fn step(
        &mut self,
        simulator: &dyn Simulator,
        on_progress: OnProgress<'_>,
    ) -> Result<(Iteration, Posterior), InferenceError> {
        let number = self.proposals.len() + 1;
        let proposal = self.next_proposal(number)?;
        self.simulate(number, proposal, simulator, on_progress)?;
        let (newest, _) = &self.proposals[number - 1];
        let indices = covered(&self.state.samples, newest);
        if indices.len() < LEAST_TRACKS {
            return Err(InferenceError::TooFewTracks {
                iteration: number,
                expected: LEAST_TRACKS,
                got: indices.len(),
                because: self.refused.as_ref().map_or(String::new(), |why| format!("; the last refused one: {why}")),
            });
        }
        let proposal_volume = if let Proposal::Region(region) = newest { region.volume() } else { 1.0 };
        let weights = balance_weights(indices.iter().map(|&i| self.state.samples.theta(i)), &self.proposals);
        let data = self.state.samples.gather(&indices);
        let outcome = self.train(number, &indices, &data, &weights, on_progress)?;
        let iteration = Iteration {
            iteration: number,
            simulations: self.state.simulations,
            tracks: indices.len(),
            unusable: self.state.simulations - self.state.samples.len(),
            loss: outcome.held_out_loss,
            effective_sample_size: effective_sample_size(&weights),
            proposal_volume,
            epochs: outcome.epochs,
        };
        let mixture = self.mixture().map_err(|reason| InferenceError::Posterior { iteration: number, reason })?;
        self.state.iterations.push(iteration.clone());
        self.state.posteriors.push(mixture.clone());
        let posterior = Posterior { parameters: self.space.clone(), mixture };
        let (of, state) = (self.settings.iterations, &self.state);
        let progress = Progress::Iteration { iteration: &iteration, of, posterior: &posterior, state };
        if on_progress(&progress).is_break() {
            return Err(InferenceError::Cancelled { simulations: self.state.simulations });
        }
        Ok((iteration, posterior))
    }

    fn next_proposal(&self, number: usize) -> Result<Proposal, InferenceError> {
        let newest = self.proposals.last().zip(self.state.posteriors.last());
        let Some(((last, _), mixture)) = newest else { return Ok(Proposal::Prior) };
        let mut rng = seed::rng(self.seed(Stream::Proposal, number), 0);
        Proposal::next(self.settings.proposal, mixture, last, number, &mut rng)
    }

    /// Draws, simulates, and keeps the usable tracks. Leaving the others out is exact: what is learnt is the posterior
    /// given usable tracks, and the measured ones are usable.
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
        let thetas: Vec<Vec<f64>> = u.iter().map(|u| self.space.from_unit(u)).collect();
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
        self.proposals.push((proposal, count));
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
        let seeds = [self.seed(Stream::Training, number), seed::derive(self.settings.seed, Stream::HeldOut as u64)];
        let before = Some(&self.state.ensemble).filter(|_| self.settings.warm_start);
        let training = Training { data, weights, lots: indices, seed: seeds[0], held_out_seed: seeds[1] };
        let (ensemble, outcome) =
            Ensemble::train(&Shape::of_samples(data, self.settings), self.settings, before, training, &mut listen)
                .map_err(|source| match source {
                    TrainingError::Stopped => InferenceError::Cancelled { simulations },
                    reason => InferenceError::Training { iteration: number, reason },
                })?;
        self.state.ensemble = ensemble;
        Ok(outcome)
    }

    /// The mean of the networks' mixtures at the measured track.
    fn mixture(&self) -> Result<Mixture, catenary_core::mixture::MixtureError> {
        let mut batch = Samples::new(self.observed.frames(), self.space.dimension());
        batch.push(&self.observed, &vec![0.5; self.space.dimension()]);
        self.state.ensemble.mixture(&batch)
    }
}
