//! Sequential inference: iterations of drawing thetas, simulating them, and training on all tracks so far.

mod iteration;
mod progress;
mod proposal;
mod region;
mod request;
mod resume;
mod state;
#[cfg(test)]
pub(crate) mod tests;

pub use iteration::Iteration;
pub use progress::{OnProgress, Progress};
pub use proposal::{Proposal, balance_weights, effective_sample_size};
pub use region::Region;
pub use request::{Observed, request};
pub use state::State;

use crate::embedding::{InputError, TrackInput};
use crate::error::InferenceError;
use crate::network::{Ensemble, Epoch, Network, Outcome, Samples, Shape, Training, TrainingError};
use crate::settings::{LEAST_TRACKS, Settings};
use catenary_core::{Mixture, ParameterSpace, Posterior, SimulationRequest, Simulator, Track, seed};

/// Number of simulations in one request. The caller may stop between two requests.
pub(crate) const PART: usize = 64;

/// Networks, tracks and proposals of an inference, after any number of iterations.
pub struct Sequential<'a> {
    space: &'a ParameterSpace,
    settings: &'a Settings,
    /// Joined tracks of all measured episodes.
    observed: TrackInput,
    /// Request that reproduces each measured episode, and the largest number of frames of its tracks.
    episodes: Vec<(SimulationRequest, usize)>,
    state: State,
    /// Proposals of all iterations with their numbers of draws, unusable ones included.
    proposals: Vec<(Proposal, usize)>,
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
fn covered(samples: &Samples, proposal: &Proposal) -> Vec<usize> {
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

    /// Proposal of the last iteration.
    pub fn proposal(&self) -> Option<&Proposal> {
        self.proposals.last().map(|(p, _)| p)
    }

    /// Samples with usable tracks so far.
    pub fn samples(&self) -> &Samples {
        &self.state.samples
    }

    /// State after the last iteration.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Measured tracks as the input of the networks.
    pub fn observed(&self) -> &TrackInput {
        &self.observed
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
        // The whole prior for proposals that cover it with some density everywhere.
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

    /// Proposal of iteration `number`: the prior in the first one.
    fn next_proposal(&self, number: usize) -> Result<Proposal, InferenceError> {
        let newest = self.proposals.last().zip(self.state.posteriors.last());
        let Some(((last, _), mixture)) = newest else { return Ok(Proposal::Prior) };
        let mut rng = seed::rng(self.seed(Stream::Proposal, number), 0);
        Proposal::next(self.settings.proposal, mixture, last, number, &mut rng)
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
        let training = Training { data, weights, split_keys: indices, seed: seeds[0], held_out_seed: seeds[1] };
        let (ensemble, outcome) =
            Ensemble::train(&Shape::of_samples(data, self.settings), self.settings, before, training, &mut listen)
                .map_err(|source| match source {
                    TrainingError::Stopped => InferenceError::Cancelled { simulations },
                    reason => InferenceError::Training { iteration: number, reason },
                })?;
        self.state.ensemble = ensemble;
        Ok(outcome)
    }

    /// Mean of the networks' mixtures at the measured tracks.
    fn mixture(&self) -> Result<Mixture, catenary_core::mixture::MixtureError> {
        let mut batch = Samples::new(self.observed.frames(), self.space.dimension());
        // A sample needs a theta, which the mixture does not depend on.
        batch.push(&self.observed, &vec![0.5; self.space.dimension()]);
        self.state.ensemble.mixture(&batch)
    }
}
