//! Networks trained side by side on the same samples; the density is the mean of theirs.

use super::spread::{self, Member};
use super::{Epoch, Network, Samples, Shape, TrainingError, train};
use crate::settings::Settings;
use catenary_core::mixture::MixtureError;
use catenary_core::{Mixture, seed};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// The networks, in order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ensemble {
    networks: Vec<Network>,
}

/// Samples to train on.
#[derive(Debug, Clone, Copy)]
pub struct Training<'a> {
    /// N samples.
    pub data: &'a Samples,
    /// N importance weights.
    pub weights: &'a [f64],
    /// N numbers, one a sample and the same in every training that the sample takes part in: they decide which network
    /// holds it out, so that held-out losses of different trainings can be compared.
    pub lots: &'a [usize],
    /// Seed of the parameters and of the order of the samples.
    pub seed: u64,
    /// Seed of what is held out.
    pub held_out_seed: u64,
}

/// What a training did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Passes over the samples, summed over the networks.
    pub epochs: usize,
    /// Held-out negative log density in nat, unit coordinates, of the widened mixtures truncated to the prior's support; mean over the
    /// networks.
    pub held_out_loss: f64,
}

impl Ensemble {
    /// Whether every network is a whole one of `shape` with finite numbers, which those of a file may not be.
    pub(crate) fn fits(&self, shape: &Shape) -> bool {
        self.networks.iter().all(|n| n.is_whole() && n.is_finite() && n.shape() == shape)
    }

    /// The networks.
    pub fn networks(&self) -> &[Network] {
        &self.networks
    }

    /// Trains `settings.ensemble` networks of `shape`, from `before`'s parameters on where those are networks of that shape,
    /// and else from random ones. `listen` hears which network made a pass, and none of it after
    /// each batch; it may stop the run.
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
        let (networks, held_out_loss) = spread::widened(members, shape.head.dimension, &mut tick)?;
        Ok((Self { networks }, Outcome { epochs, held_out_loss }))
    }

    /// The mean of the networks' mixtures at the one sample in `batch`.
    pub fn mixture(&self, batch: &Samples) -> Result<Mixture, MixtureError> {
        let (mut weights, mut means, mut covariances) = (Vec::new(), Vec::new(), Vec::new());
        for network in &self.networks {
            let (w, m, c) = network.mixture_parts(batch);
            weights.extend(w);
            means.extend(m);
            covariances.extend(c);
        }
        Mixture::new(&weights, means, covariances)
    }
}

/// The samples that network `member` holds out, and those that it trains on.
fn split(training: &Training<'_>, held_out_share: f64, member: usize) -> (Vec<usize>, Vec<usize>) {
    let stream = seed::derive(training.held_out_seed, member as u64);
    let lot = |i: usize| (seed::derive(stream, i as u64) >> 11) as f64 / (1u64 << 53) as f64;
    let (mut held_out, mut used): (Vec<usize>, Vec<usize>) =
        (0..training.lots.len()).partition(|&i| lot(training.lots[i]) < held_out_share);
    if held_out.is_empty() {
        held_out.extend(used.pop());
    }
    if used.is_empty() {
        used.extend(held_out.pop());
    }
    (held_out, used)
}
