//! Descent of a training.

use crate::adam::Adam;
use crate::schedule::{clip, rate};
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

/// Reason for which a training ended early.
#[derive(Debug, Error, Clone, Copy, PartialEq)]
pub enum Stopped {
    /// The caller told it to end.
    #[error("the training was interrupted")]
    Interrupted,
    /// The loss of a step is not finite.
    #[error("loss: expected a finite number, got {loss} in step {step}: a lower rate may help")]
    NotFinite {
        /// Loss of the step.
        loss: f64,
        /// Number of the step, from 0.
        step: usize,
    },
}

/// Descends along the gradients of batches. `slope` takes the numbers of the samples and the weights, writes the gradient and returns the
/// loss. `tell` is called after each step, and ends the training if it returns false.
///
/// # Errors
/// [`Stopped`].
pub fn descend(
    settings: &TrainingSettings,
    mut weights: Vec<f32>,
    mut tell: impl FnMut(Progress) -> bool,
    mut slope: impl FnMut(&[u64], &[f32], &mut [f32]) -> f64,
) -> Result<Vec<f32>, Stopped> {
    let mut adam = Adam::new(weights.len());
    let mut gradient = vec![0.0; weights.len()];
    for step in 0..settings.steps {
        let samples: Vec<u64> = (0..settings.batch as u64).map(|k| (step * settings.batch) as u64 + k).collect();
        let loss = slope(&samples, &weights, &mut gradient);
        if !loss.is_finite() {
            return Err(Stopped::NotFinite { loss, step });
        }
        clip(&mut gradient);
        adam.step(&mut weights, &gradient, rate(settings.rate, step, settings.steps));
        if !tell(Progress { step: step + 1, loss }) {
            return Err(Stopped::Interrupted);
        }
    }
    Ok(weights)
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
        let found = descend(&SETTINGS, vec![2.0], |_| true, bowl).unwrap();
        assert!((found[0] - 0.5).abs() < 0.02, "{found:?}");
        assert_eq!(descend(&SETTINGS, vec![2.0], |p| p.step < 3, bowl), Err(Stopped::Interrupted));
        let mut seen = Vec::new();
        let lost = descend(
            &SETTINGS,
            vec![2.0],
            |_| true,
            |samples, _, _| {
                seen.extend(samples.to_vec());
                if samples[0] == 4 { f64::INFINITY } else { 0.0 }
            },
        );
        assert_eq!((lost, seen), (Err(Stopped::NotFinite { loss: f64::INFINITY, step: 2 }), vec![0, 1, 2, 3, 4, 5]));
    }
}
