//! Training of one network: Adam on shuffled batches, clipping of the global norm, early stopping on held-out tracks.

use super::{Activations, Network, Samples};
use crate::settings::{DECAYED_TRACKS, Schedule};
use rand::Rng;
use rand::seq::SliceRandom;
use std::ops::ControlFlow;
use thiserror::Error;

/// State of a training run after a pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// Number of passes so far.
    pub epoch: usize,
    /// Held-out loss in nat, in unit coordinates.
    pub held_out_loss: f64,
}

/// Outcome of a training run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trained {
    /// Number of passes.
    pub epochs: usize,
    /// Best held-out loss in nat, in unit coordinates.
    pub held_out_loss: f64,
}

/// Reason for which a network was not trained.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum TrainingError {
    /// The loss or the gradient is not finite.
    #[error(
        "training failed in epoch {epoch}: {what} is {value}, expected a finite number; a lower learning rate or gradient norm may help"
    )]
    NotFinite {
        /// Number of the pass, from 1.
        epoch: usize,
        /// Name of the value that is not finite.
        what: &'static str,
        /// Value.
        value: f64,
    },
    /// The caller stopped the training.
    #[error("training was stopped by the caller")]
    Stopped,
}

/// Adam's moments (Kingma and Ba 2015), with decoupled weight decay (Loshchilov and Hutter 2019).
struct Adam {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: i32,
}

/// Weight decay of a training.
struct Decay {
    /// Index of the first parameter that decays.
    from: usize,
    /// Strength as a share of the learning rate.
    strength: f64,
}

/// Decay of Adam's first moment (Kingma and Ba 2015).
const BETA_1: f32 = 0.9;
/// Decay of Adam's second moment (Kingma and Ba 2015).
const BETA_2: f32 = 0.999;
/// Term in Adam's denominator (Kingma and Ba 2015).
const EPSILON: f32 = 1e-8;

impl Adam {
    fn new(count: usize) -> Self {
        Self { first: vec![0.0; count], second: vec![0.0; count], steps: 0 }
    }

    /// Takes one step against `scale` times the gradient.
    fn step(&mut self, parameters: &mut [f32], gradient: &[f32], scale: f32, learning_rate: f64, decay: &Decay) {
        self.steps += 1;
        let correction_1 = 1.0 - BETA_1.powi(self.steps);
        let correction_2 = 1.0 - BETA_2.powi(self.steps);
        let rate = learning_rate as f32 * correction_2.sqrt() / correction_1;
        let epsilon = EPSILON * correction_2.sqrt();
        let kept = 1.0 - (learning_rate * decay.strength) as f32;
        parameters[decay.from..].iter_mut().for_each(|p| *p *= kept);
        let moments = self.first.iter_mut().zip(&mut self.second);
        for ((p, g), (m, v)) in parameters.iter_mut().zip(gradient).zip(moments) {
            let g = g * scale;
            *m += (1.0 - BETA_1) * (g - *m);
            *v += (1.0 - BETA_2) * (g * g - *v);
            *p -= rate * *m / (v.sqrt() + epsilon);
        }
    }
}

/// Largest share of the steps so far over which parameters are averaged: those of the beginning are far from the optimum.
const AVERAGED_SHARE: f32 = 0.1;

/// Trains `network` on the samples at `training` with early stopping on those at `held_out`. `weights` (N) belong to all
/// samples. `listen` gets the state after each pass and none after each batch; it may stop the training.
///
/// # Errors
/// [`TrainingError`] if the loss or the gradient is not finite, or `listen` breaks.
#[allow(
    clippy::too_many_arguments,
    reason = "data, two index lists, weights, schedule, random source and listener belong to different owners"
)]
pub fn train<R: Rng>(
    network: &mut Network,
    samples: &Samples,
    training: &[usize],
    held_out: &[usize],
    weights: &[f64],
    schedule: &Schedule,
    rng: &mut R,
    listen: &mut dyn FnMut(Option<Epoch>) -> ControlFlow<()>,
) -> Result<Trained, TrainingError> {
    // A fixed embedding is evaluated once.
    let all = if schedule.train_embedding { Vec::new() } else { network.inputs(samples) };
    let width = network.shape().inputs();
    let picked = |network: &Network, indices: &[usize]| {
        let batch = samples.gather(indices);
        let x = if schedule.train_embedding {
            network.inputs(&batch)
        } else {
            indices.iter().flat_map(|&i| all[i * width..(i + 1) * width].iter().copied()).collect()
        };
        (batch, x)
    };
    let watched_weights: Vec<f64> = held_out.iter().map(|&i| weights[i]).collect();
    // Weights are scaled to a mean of one, so that the learning rate does not depend on their size.
    let mean_weight = training.iter().map(|&i| weights[i]).sum::<f64>() / training.len() as f64;
    let mut work = Activations::default();
    let mut gradient = vec![0.0; network.parameters().len()];
    let mut adam = Adam::new(gradient.len());
    let share = (DECAYED_TRACKS as f64 / training.len() as f64).min(1.0);
    let decay = Decay { from: network.shape().embedding.parameter_count(), strength: schedule.weight_decay * share };
    let mut order = training.to_vec();
    let watch = |network: &Network, work: &mut Activations| {
        let (batch, x) = picked(network, held_out);
        network.loss(&x, batch.thetas(), &watched_weights, work)
    };
    let mut best = (watch(network, &mut work), 0, network.parameters().to_vec());
    let mut averaged = network.clone();
    let mut steps = 0;
    let mut epoch = 0;
    while epoch < schedule.max_epochs && epoch - best.1 < schedule.patience_epochs {
        epoch += 1;
        order.shuffle(rng);
        for indices in order.chunks(schedule.batch_size) {
            let (batch, x) = picked(network, indices);
            let batch_weights: Vec<f64> = indices.iter().map(|&i| weights[i] / mean_weight).collect();
            let (loss, by_input) =
                network.loss_and_gradient(&x, batch.thetas(), &batch_weights, &mut work, &mut gradient);
            if schedule.train_embedding {
                network.embedding_gradient(&batch, by_input, &mut gradient);
            }
            check(epoch, "the loss", loss)?;
            let norm = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
            check(epoch, "the norm of the gradient", norm)?;
            let scale = (schedule.max_gradient_norm / norm.max(f64::MIN_POSITIVE)).min(1.0) as f32;
            adam.step(network.parameters_mut(), &gradient, scale, schedule.learning_rate, &decay);
            steps += 1;
            let share = (1.0 / (AVERAGED_SHARE * steps as f32)).clamp(1.0 / schedule.averaged_steps as f32, 1.0);
            let pairs = averaged.parameters_mut().iter_mut().zip(network.parameters());
            pairs.for_each(|(a, p)| *a += share * (p - *a));
            if listen(None).is_break() {
                return Err(TrainingError::Stopped);
            }
        }
        let held_out_loss = watch(&averaged, &mut work);
        check(epoch, "the held-out loss", held_out_loss)?;
        // The loss before the first pass may be infinite, for a warm start far from the new tracks.
        if held_out_loss < best.0 || !best.0.is_finite() {
            best = (held_out_loss, epoch, averaged.parameters().to_vec());
        }
        if listen(Some(Epoch { epoch, held_out_loss })).is_break() {
            return Err(TrainingError::Stopped);
        }
    }
    network.parameters_mut().copy_from_slice(&best.2);
    Ok(Trained { epochs: epoch, held_out_loss: best.0 })
}

/// Fails if `value` is not finite.
fn check(epoch: usize, what: &'static str, value: f64) -> Result<(), TrainingError> {
    if value.is_finite() { Ok(()) } else { Err(TrainingError::NotFinite { epoch, what, value }) }
}
