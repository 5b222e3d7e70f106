//! Steps of a training.

use serde::{Deserialize, Serialize};

/// Adam (Kingma and Ba 2015, algorithm 1) with decay of the weights apart from the gradient (Loshchilov and Hutter 2019).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Adam {
    mean: Vec<f32>,
    square: Vec<f32>,
    steps: i32,
    /// Share of each weight that a step of rate 1 removes.
    pub decay: f32,
}

impl Adam {
    /// State before the first step, for `weights` weights.
    #[must_use]
    pub fn new(weights: usize) -> Self {
        Self { mean: vec![0.0; weights], square: vec![0.0; weights], steps: 0, decay: 0.0 }
    }

    /// True if it has the moments of `weights` weights.
    #[must_use]
    pub fn is_of(&self, weights: usize) -> bool {
        self.mean.len() == weights && self.square.len() == weights && self.steps >= 0
    }

    /// Moves the weights against the gradient.
    pub fn step(&mut self, weights: &mut [f32], gradient: &[f32], rate: f32) {
        const KEEP_MEAN: f32 = 0.9;
        const KEEP_SQUARE: f32 = 0.999;
        self.steps += 1;
        let (of_mean, of_square) = (1.0 - KEEP_MEAN.powi(self.steps), 1.0 - KEEP_SQUARE.powi(self.steps));
        for (((w, g), m), v) in weights.iter_mut().zip(gradient).zip(&mut self.mean).zip(&mut self.square) {
            *m = KEEP_MEAN * *m + (1.0 - KEEP_MEAN) * g;
            *v = KEEP_SQUARE * *v + (1.0 - KEEP_SQUARE) * g * g;
            *w -= rate * (*m / of_mean / ((*v / of_square).sqrt() + 1e-8) + self.decay * *w);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_rate_and_the_minimum_is_found() {
        let (mut adam, mut weights) = (Adam::new(2), [1.0_f32, -3.0]);
        adam.step(&mut weights, &[5.0, -0.1], 0.01);
        assert!((weights[0] - 0.99).abs() < 1e-6 && (weights[1] + 2.99).abs() < 1e-6, "{weights:?}");
        for _ in 0..2000 {
            let gradient = weights.map(|w| 2.0 * (w - 0.5));
            adam.step(&mut weights, &gradient, 0.01);
        }
        assert!(weights.iter().all(|w| (w - 0.5).abs() < 1e-3), "{weights:?}");
    }
}
