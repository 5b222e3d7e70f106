//! Ensemble of networks. Each network holds out its own share of the samples and trains on the rest. The density of the
//! ensemble is the mean of the networks' densities.

use super::conformal::{self, Marginal};
use super::head::Parts;
use super::inflation::{self, Member};
use super::{Activations, Epoch, Network, Samples, Shape, TrainingError, train};
use crate::settings::Settings;
use crate::unit_map::UnitMap;
use catenary_core::mixture::MixtureError;
use catenary_core::{Mixture, seed};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Ensemble of networks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ensemble {
    networks: Vec<Network>,
}

/// Training data of an ensemble.
#[derive(Debug, Clone, Copy)]
pub struct Training<'a> {
    /// Samples, N.
    pub data: &'a Samples,
    /// Importance weights, N.
    pub weights: &'a [f64],
    /// Keys, N, by which each network decides which samples it holds out. A sample keeps its key in all trainings, so that
    /// the held-out losses of different trainings are comparable.
    pub split_keys: &'a [usize],
    /// Seed of the initial parameters and of the order of the samples.
    pub seed: u64,
    /// Seed of the choice of held-out samples.
    pub held_out_seed: u64,
}

/// Outcome of the training of an ensemble.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Passes over the samples, summed over the networks.
    pub epochs: usize,
    /// Held-out loss, mean over the networks: negative log density in nat, in unit coordinates. The density is that of a
    /// network's mixture after the inflation of its covariances (see `inflation`) and truncation to the prior's support.
    pub held_out_loss: f64,
}

/// Factors that widen a posterior until its intervals hold their share of held-out samples.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalFactors {
    /// Number of held-out samples, summed over the networks.
    pub held_out: usize,
    /// Factor of the standard deviations along each axis (D), at least 1.
    pub factors: Vec<f64>,
    /// Share of held-out samples in their 90 % intervals before, by axis (D).
    pub coverage: Vec<f64>,
}

impl Ensemble {
    /// Returns true if every network is complete, finite and of `shape`. Networks from a file can be
    /// incomplete, not finite or of another shape.
    pub(crate) fn fits(&self, shape: &Shape) -> bool {
        self.networks.iter().all(|n| n.is_whole() && n.is_finite() && n.shape() == shape)
    }

    /// Networks in order.
    pub fn networks(&self) -> &[Network] {
        &self.networks
    }

    /// Converts the mixtures of all networks to other unit coordinates.
    pub(crate) fn map_thetas(&mut self, map: &UnitMap) {
        self.networks.iter_mut().for_each(|n| n.map_thetas(map));
    }

    /// Trains `settings.ensemble` networks of `shape`, with a warm start from networks of that shape in `before`. `listen` gets
    /// the index of a network, and its [`Epoch`] after each pass. After each batch and during the inflation it gets None instead.
    /// `listen` stops the training by returning `Break`.
    ///
    /// # Errors
    /// [`TrainingError`] if a loss is not finite or `listen` breaks.
    pub fn train(
        shape: &Shape,
        settings: &Settings,
        before: Option<&Self>,
        training: Training<'_>,
        listen: &mut dyn FnMut(usize, Option<Epoch>) -> ControlFlow<()>,
    ) -> Result<(Self, Outcome), TrainingError> {
        let Training { data, weights, .. } = training;
        let mut epochs = 0;
        let mut members = Vec::with_capacity(settings.ensemble);
        for member in 0..settings.ensemble {
            let mut rng = seed::rng(training.seed, member as u64);
            let last = before.and_then(|b| b.networks.get(member)).filter(|n| n.shape() == shape);
            let mut network = match last {
                Some(last) => last.restarted(data, weights, &mut rng),
                None => Network::new(shape.clone(), settings.length_scale, data, weights, &mut rng),
            };
            let (held_out, used) = split(&training, settings.held_out_share, member);
            let mut hear = |epoch| listen(member, epoch);
            let trained =
                train(&mut network, data, &used, &held_out, weights, &settings.schedule, &mut rng, &mut hear)?;
            epochs += trained.epochs;
            members.push(Member::new(network, data, weights, &held_out));
        }
        let mut tick = || listen(settings.ensemble - 1, None);
        let (networks, held_out_loss) = inflation::inflated(members, shape.head.dimension, &mut tick)?;
        Ok((Self { networks }, Outcome { epochs, held_out_loss }))
    }

    /// Mean of the networks' mixtures at the one sample in `batch`.
    ///
    /// # Errors
    /// [`MixtureError`] if the outputs of the networks are no valid mixture.
    pub fn mixture(&self, batch: &Samples) -> Result<Mixture, MixtureError> {
        self.joined(|network| network.mixture_parts(batch))
    }

    /// Mean of the networks' mixtures at the one sample in `batch`, with standard deviations multiplied by `factors` (D) along
    /// the axes.
    ///
    /// # Errors
    /// [`MixtureError`] if the outputs of the networks are no valid mixture.
    pub fn widened_mixture(&self, batch: &Samples, factors: &[f64]) -> Result<Mixture, MixtureError> {
        self.joined(|network| network.widened_parts(batch, factors))
    }

    /// Interval factors from the samples that the networks held out of `training`, each of its own.
    pub fn interval_factors(&self, training: &Training<'_>, held_out_share: f64) -> IntervalFactors {
        let dimension = training.data.dimension();
        let mut marginals: Vec<Vec<Marginal>> = (0..dimension).map(|_| Vec::new()).collect();
        for (member, network) in self.networks.iter().enumerate() {
            let (held_out, _) = split(training, held_out_share, member);
            let batch = training.data.gather(&held_out);
            let mut work = Activations::default();
            let raw = network.forward(&network.inputs(&batch), &mut work);
            for (i, raw) in raw.chunks_exact(network.shape().head.outputs()).enumerate() {
                let parts = network.parts(raw);
                for (axis, list) in marginals.iter_mut().enumerate() {
                    let weight = training.weights[held_out[i]];
                    list.push(Marginal::new(&parts, axis, batch.theta(i)[axis], weight));
                }
            }
        }
        IntervalFactors {
            held_out: marginals.first().map_or(0, Vec::len),
            factors: marginals.iter().map(|m| conformal::factor(m)).collect(),
            coverage: marginals.iter().map(|m| conformal::coverage(m, 1.0)).collect(),
        }
    }

    /// Mean of one mixture of each network.
    fn joined(&self, parts: impl Fn(&Network) -> Parts) -> Result<Mixture, MixtureError> {
        let (mut weights, mut means, mut covariances) = (Vec::new(), Vec::new(), Vec::new());
        for network in &self.networks {
            let (w, m, c) = parts(network);
            weights.extend(w);
            means.extend(m);
            covariances.extend(c);
        }
        Mixture::new(&weights, means, covariances)
    }
}

/// Indices of the samples that network `member` holds out, and of those on which it trains.
fn split(training: &Training<'_>, held_out_share: f64, member: usize) -> (Vec<usize>, Vec<usize>) {
    let stream = seed::derive(training.held_out_seed, member as u64);
    // The upper 53 bits of a hash as a number from 0 to 1.
    let lot = |i: usize| (seed::derive(stream, i as u64) >> 11) as f64 / (1u64 << 53) as f64;
    let (mut held_out, mut used): (Vec<usize>, Vec<usize>) =
        (0..training.split_keys.len()).partition(|&i| lot(training.split_keys[i]) < held_out_share);
    // Both lists need a sample: few samples may all fall on one side.
    if held_out.is_empty() {
        held_out.extend(used.pop());
    }
    if used.is_empty() {
        used.extend(held_out.pop());
    }
    (held_out, used)
}
