//! Training of the network on generated pictures.

use catenary_core::image::label;
use catenary_core::seed;
use convnet::{Descent, Net, Pass, Progress, Sample, TrainingSettings, WeightsError, batch_gradient, descend};

use super::frame::LabelledFrame;
use super::generator::Picture;
use super::network::{MASKS, Weights, fill, network};
use super::size::SIDE;
use crate::Error;

/// Stream of random numbers of the first weights.
const START: u64 = u64::MAX;
/// Weight of the overlap (Dice) beside the cross entropy. The object covers few pixels, which cross entropy alone counts for little.
const OVERLAP: f32 = 0.5;
/// Weight of a labelled pixel in the cross entropy.
const LABELLED: f32 = 3.0;

/// Settings of the shipped weights.
pub const SHIPPED_TRAINING: TrainingSettings =
    TrainingSettings { steps: 8_000, batch: 8, rate: 3e-3, threads: 2, seed: 1 };

/// Start of a training.
#[derive(Debug, Clone, PartialEq)]
pub enum Start {
    /// Random weights, drawn with the seed.
    Random,
    /// Weights of an earlier training.
    Weights(Weights),
    /// State of an interrupted training with the same settings, start and frames.
    Begun(Box<Descent>),
}

/// Trains a network on generated pictures. If there are labelled frames, every other picture is
/// one of them. `tell` is called after each step, and ends the training with an error if it returns false.
///
/// # Errors
/// [`Error::Training`]; [`Error::Weights`] for a start of another network.
pub fn train(
    settings: &TrainingSettings,
    start: Start,
    frames: &[LabelledFrame],
    tell: impl FnMut(Progress) -> bool,
) -> Result<Weights, Error> {
    let net = network();
    let begun = match start {
        Start::Random => Descent::new(net.initial(&mut seed::rng(settings.seed, START))),
        Start::Weights(weights) => Descent::new(weights),
        Start::Begun(begun) => *begun,
    };
    if !begun.is_of(net.weights()) {
        return Err(WeightsError { expected: net.weights(), got: begun.weights().len().to_string() }.into());
    }
    let mut passes: Vec<Pass> = (0..settings.threads.max(1)).map(|_| Pass::new(&net)).collect();
    let trained = descend(settings, begun, tell, |streams, weights, gradient| {
        let drawn = |&stream: &u64| Drawn { seed: settings.seed, stream, frames };
        let samples: Vec<Drawn<'_>> = streams.iter().map(drawn).collect();
        batch_gradient(&net, weights, &samples, &mut passes, gradient)
    })?;
    Ok(trained)
}

/// Picture of a training, drawn when it is needed.
struct Drawn<'a> {
    seed: u64,
    stream: u64,
    frames: &'a [LabelledFrame],
}

impl Drawn<'_> {
    fn picture(&self) -> Picture {
        let mut rng = seed::rng(self.seed, self.stream);
        // Every frame has its turn.
        match self.frames.get((self.stream / 2) as usize % self.frames.len().max(1)) {
            Some(frame) if self.stream % 2 == 1 => frame.picture(&mut rng),
            _ => Picture::draw(&mut rng),
        }
    }
}

impl Sample for Drawn<'_> {
    type Truth = Vec<u8>;

    fn fill(&self, net: &Net, input: &mut [f32]) -> Vec<u8> {
        let picture = self.picture();
        fill(net, input, &picture.clicked, |i| picture.pixels[i]);
        picture.labels
    }

    fn judge(&self, net: &Net, labels: &Vec<u8>, output: &[f32], pull: &mut [f32]) -> f64 {
        let shape = net.output();
        let pixels = (SIDE * SIDE) as f32;
        let mut loss = 0.0;
        for (mask, label) in [label::DLO, label::TARGET].into_iter().enumerate().take(MASKS) {
            let (mut entropy, mut common, mut sum, mut truth) = (0.0_f64, 0.0_f32, 0.0_f32, 0.0_f32);
            let total: f32 = labels.iter().map(|&l| if l == label { LABELLED } else { 1.0 }).sum();
            for v in 0..SIDE {
                let row = shape.row(mask, v);
                for (u, (&x, pull)) in output[row.clone()].iter().zip(&mut pull[row]).enumerate() {
                    let y = if labels[v * SIDE + u] == label { 1.0 } else { 0.0 };
                    let p = 1.0 / (1.0 + (-x).exp());
                    let weight = if y > 0.0 { LABELLED } else { 1.0 };
                    // Far from zero the logarithm of the probability is the log odds themselves.
                    let lost = if y > 0.0 { -x } else { x };
                    let loss = if lost > 15.0 { lost } else { -(if y > 0.0 { p } else { 1.0 - p }).max(1e-7).ln() };
                    entropy += f64::from(weight * loss);
                    *pull = weight * (p - y) / total;
                    common += p * y;
                    sum += p;
                    truth += y;
                }
            }
            loss += entropy / f64::from(total);
            // One is added to both sides, so that an empty mask has a meaning.
            let (over, under) = (2.0 * common + 1.0, sum + truth + 1.0);
            loss += f64::from(OVERLAP * (1.0 - over / under));
            for v in 0..SIDE {
                let row = shape.row(mask, v);
                for (u, (&x, pull)) in output[row.clone()].iter().zip(&mut pull[row]).enumerate() {
                    let y = if labels[v * SIDE + u] == label { 1.0 } else { 0.0 };
                    let p = 1.0 / (1.0 + (-x).exp());
                    *pull -= OVERLAP * (2.0 * y / under - over / (under * under)) * p * (1.0 - p);
                }
            }
            debug_assert!(total >= pixels);
        }
        loss
    }
}
