//! Adam (Kingma and Ba 2015) over blocks of parameters, with clipping of the gradient's global norm.

use serde::{Deserialize, Serialize};

/// Decay of the first moment (Kingma and Ba 2015).
const BETA1: f32 = 0.9;
/// Decay of the second moment (Kingma and Ba 2015).
const BETA2: f32 = 0.999;
/// Term in the denominator. Implementations of PPO use 1e-5 instead of Adam's 1e-8 (Huang et al. 2022, "The 37
/// implementation details of proximal policy optimization").
const EPSILON: f32 = 1e-5;

/// Parameters and their gradient, of equal length.
pub type Block<'a> = (&'a mut [f32], &'a [f32]);

/// Optimiser with the moments of all blocks.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Adam {
    steps: i32,
    /// First and second moment of each block.
    moments: Vec<(Vec<f32>, Vec<f32>)>,
}

impl Adam {
    /// Numbers of parameters of the blocks; empty before the first step.
    pub fn sizes(&self) -> Vec<usize> {
        let sizes = |(first, second): &(Vec<f32>, Vec<f32>)| first.len().max(second.len());
        self.moments.iter().map(sizes).collect()
    }

    /// True if all moments are whole and finite, as those of a training are that has not diverged.
    pub fn is_whole(&self) -> bool {
        let finite = |v: &Vec<f32>| v.iter().all(|m| m.is_finite());
        self.steps >= 0 && self.moments.iter().all(|(a, b)| a.len() == b.len() && finite(a) && finite(b))
    }

    /// Takes a step of size `learning_rate` against the gradients. If their norm over all blocks exceeds `max_norm`, they are
    /// scaled down to it. Every call must have the same blocks. Returns the norm before scaling.
    pub fn step(&mut self, blocks: &mut [Block<'_>], learning_rate: f32, max_norm: f32) -> f32 {
        if self.moments.is_empty() {
            self.moments = blocks.iter().map(|(p, _)| (vec![0.0; p.len()], vec![0.0; p.len()])).collect();
        }
        let squares = |g: &[f32]| g.iter().map(|v| v * v).sum::<f32>();
        let norm = blocks.iter().map(|(_, g)| squares(g)).sum::<f32>().sqrt();
        // The small term guards the division, as in PyTorch's `clip_grad_norm_`.
        let scale = if norm > max_norm { max_norm / (norm + 1e-6) } else { 1.0 };
        self.steps += 1;
        let (correction1, correction2) = (1.0 - BETA1.powi(self.steps), 1.0 - BETA2.powi(self.steps));
        for ((parameters, gradient), (first, second)) in blocks.iter_mut().zip(&mut self.moments) {
            for (((p, g), m), v) in parameters.iter_mut().zip(gradient.iter()).zip(first).zip(second) {
                let g = g * scale;
                *m = BETA1 * *m + (1.0 - BETA1) * g;
                *v = BETA2 * *v + (1.0 - BETA2) * g * g;
                *p -= learning_rate * (*m / correction1) / ((*v / correction2).sqrt() + EPSILON);
            }
        }
        norm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_finds_the_minimum_of_a_quadratic() {
        let (mut p, mut adam) = (vec![3.0f32, -2.0], Adam::default());
        for _ in 0..2000 {
            let g: Vec<f32> = p.iter().map(|v| 2.0 * v).collect();
            adam.step(&mut [(&mut p[..], &g[..])], 0.01, 10.0);
        }
        assert!(p.iter().all(|v| v.abs() < 1e-2), "{p:?}");
    }

    #[test]
    fn the_norm_is_clipped_over_all_blocks_together() {
        let (mut a, mut b, mut adam) = (vec![0.0f32], vec![0.0f32], Adam::default());
        let norm = adam.step(&mut [(&mut a[..], &[3.0][..]), (&mut b[..], &[4.0][..])], 1.0, 0.5);
        assert_eq!(norm, 5.0);
        assert!((adam.moments[0].0[0] - 0.1 * 0.3).abs() < 1e-6, "{adam:?}");
    }
}
