//! Descent of a training.

use crate::adam::Adam;
use crate::schedule::{clip, rate};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Sizes of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingSettings {
    /// Number of steps.
    pub steps: usize,
    /// Samples of a step.
    pub batch: usize,
    /// Greatest rate of Adam. It rises over the first 5 % of the steps, and falls to zero as a cosine.
    pub rate: f32,
    /// Number of threads.
    pub threads: usize,
    /// Seed of the samples and of the first weights.
    pub seed: u64,
}

/// State of a training after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Number of steps that are done.
    pub step: usize,
    /// Mean loss of the step's samples.
    pub loss: f64,
}

/// State of a descent between two steps. A descent that goes on from it ends with the bits of an uninterrupted one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Descent {
    weights: Vec<f32>,
    adam: Adam,
    step: usize,
}

impl Descent {
    /// Before the first step.
    #[must_use]
    pub fn new(weights: Vec<f32>) -> Self {
        Self { adam: Adam::new(weights.len()), weights, step: 0 }
    }

    /// Weights so far.
    #[must_use]
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Number of steps that are done.
    #[must_use]
    pub fn step(&self) -> usize {
        self.step
    }

    /// True if it has finite weights of a network with this number of them, and their moments.
    #[must_use]
    pub fn is_of(&self, weights: usize) -> bool {
        self.weights.len() == weights && self.adam.is_of(weights) && self.weights.iter().all(|w| w.is_finite())
    }
}

/// Reason for which a training ended early.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum Stopped {
    /// The caller told it to end. The state is that after the last step.
    #[error("the training was interrupted after {} steps", .0.step)]
    Interrupted(Box<Descent>),
    /// The loss of a step is not finite.
    #[error("loss: expected a finite number, got {loss} in step {step}: a lower rate may help")]
    NotFinite {
        /// Loss of the step.
        loss: f64,
        /// Number of the step, from 0.
        step: usize,
    },
}

/// Descends along the gradients of batches, from `begun`. `slope` takes the numbers of the samples and the weights, writes the gradient and returns the
/// loss. `tell` is called after each step, and ends the training if it returns false.
///
/// # Errors
/// [`Stopped`].
pub fn descend(
    settings: &TrainingSettings,
    mut begun: Descent,
    mut tell: impl FnMut(Progress) -> bool,
    mut slope: impl FnMut(&[u64], &[f32], &mut [f32]) -> f64,
) -> Result<Vec<f32>, Stopped> {
    let mut gradient = vec![0.0; begun.weights.len()];
    while begun.step < settings.steps {
        let step = begun.step;
        let samples: Vec<u64> = (0..settings.batch as u64).map(|k| (step * settings.batch) as u64 + k).collect();
        let loss = slope(&samples, &begun.weights, &mut gradient);
        if !loss.is_finite() {
            return Err(Stopped::NotFinite { loss, step });
        }
        clip(&mut gradient);
        begun.adam.step(&mut begun.weights, &gradient, rate(settings.rate, step, settings.steps));
        begun.step += 1;
        // A training that is done is no interrupted one.
        if !tell(Progress { step: begun.step, loss }) && begun.step < settings.steps {
            return Err(Stopped::Interrupted(Box::new(begun)));
        }
    }
    Ok(begun.weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: TrainingSettings = TrainingSettings { steps: 400, batch: 2, rate: 0.05, threads: 1, seed: 1 };

    #[test]
    fn a_descent_finds_a_minimum_and_ends_when_it_is_told_or_lost() {
        let bowl = |_: &[u64], w: &[f32], gradient: &mut [f32]| {
            gradient[0] = 2.0 * (w[0] - 0.5);
            f64::from((w[0] - 0.5).powi(2))
        };
        let found = descend(&SETTINGS, Descent::new(vec![2.0]), |_| true, bowl).unwrap();
        assert!((found[0] - 0.5).abs() < 0.02, "{found:?}");
        let stopped = descend(&SETTINGS, Descent::new(vec![2.0]), |p| p.step < 3, bowl);
        let Err(Stopped::Interrupted(begun)) = stopped else { panic!("{stopped:?}") };
        assert!(begun.step() == 3 && begun.is_of(1) && !begun.is_of(2) && begun.weights()[0] < 2.0);
        assert_eq!(descend(&SETTINGS, *begun, |_| true, bowl).unwrap(), found, "another end than without the stop");
        let mut seen = Vec::new();
        let lost = descend(
            &SETTINGS,
            Descent::new(vec![2.0]),
            |_| true,
            |samples, _, _| {
                seen.extend(samples.to_vec());
                if samples[0] == 4 { f64::INFINITY } else { 0.0 }
            },
        );
        assert_eq!((lost, seen), (Err(Stopped::NotFinite { loss: f64::INFINITY, step: 2 }), vec![0, 1, 2, 3, 4, 5]));
    }
}
