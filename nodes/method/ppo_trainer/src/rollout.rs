//! Samples between two updates, with their advantages.

/// One step of one environment.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Sampled action in units of the action limit, not clipped.
    pub action: [f32; 2],
    /// Log density of the action when it was sampled.
    pub log_probability: f32,
    /// Value of the observation when the action was sampled.
    pub value: f32,
    /// Reward. If the step cut the episode off, the discounted value of its last observation is added.
    pub reward: f32,
    /// True if the episode ended with this step.
    pub done: bool,
}

/// Samples of all environments; the index is step * environments + environment.
#[derive(Debug, Clone, Default)]
pub struct Rollout {
    /// Samples.
    pub samples: Vec<Sample>,
    /// Inputs of the networks for each sample, row by row: normalised observations, the newest first.
    pub inputs: Vec<f32>,
    /// Generalised advantage estimate of each sample (Schulman et al. 2016).
    pub advantages: Vec<f32>,
    /// Target of the value function for each sample: advantage + value.
    pub returns: Vec<f32>,
}

impl Rollout {
    /// Inputs of the networks for sample `index`.
    pub fn inputs_of(&self, index: usize) -> &[f32] {
        let width = self.inputs.len() / self.samples.len();
        &self.inputs[index * width..(index + 1) * width]
    }

    /// Fills in advantages and returns: `A_t = delta_t + gamma lambda A_(t+1)` with `delta_t = r_t + gamma V_(t+1) - V_t`,
    /// restarted at the end of each episode. `last_values` holds the value of each environment's next observation.
    pub fn estimate(&mut self, last_values: &[f32], gamma: f32, lambda: f32) {
        let n = last_values.len();
        let steps = self.samples.len() / n;
        self.advantages.clear();
        self.advantages.resize(self.samples.len(), 0.0);
        for e in 0..n {
            let (mut next_value, mut advantage) = (last_values[e], 0.0);
            for t in (0..steps).rev() {
                let s = &self.samples[t * n + e];
                // Nothing after the end of an episode counts for its steps.
                let goes_on = if s.done { 0.0 } else { 1.0 };
                let delta = s.reward + gamma * next_value * goes_on - s.value;
                advantage = delta + gamma * lambda * goes_on * advantage;
                self.advantages[t * n + e] = advantage;
                next_value = s.value;
            }
        }
        self.returns = self.advantages.iter().zip(&self.samples).map(|(a, s)| a + s.value).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(reward: f32, value: f32, done: bool) -> Sample {
        Sample { action: [0.0; 2], log_probability: 0.0, value, reward, done }
    }

    #[test]
    fn advantages_follow_the_recursion_and_stop_at_ends() {
        let mut r = Rollout {
            samples: vec![sample(1.0, 0.5, false), sample(2.0, 0.4, true), sample(3.0, 0.3, false)],
            ..Rollout::default()
        };
        r.estimate(&[10.0], 0.9, 0.8);
        let a2 = 3.0 + 0.9 * 10.0 - 0.3;
        let a1 = 2.0 - 0.4;
        let a0 = 1.0 + 0.9 * 0.4 - 0.5 + 0.9 * 0.8 * a1;
        for (got, expected) in r.advantages.iter().zip([a0, a1, a2]) {
            assert!((got - expected).abs() < 1e-5, "{got} against {expected}");
        }
        assert!((r.returns[2] - (a2 + 0.3)).abs() < 1e-5);
    }

    #[test]
    fn environments_do_not_mix() {
        let mut r = Rollout { samples: vec![sample(1.0, 0.0, false), sample(100.0, 0.0, false)], ..Rollout::default() };
        r.estimate(&[0.0, 0.0], 0.9, 0.9);
        assert_eq!(r.advantages, [1.0, 100.0]);
    }
}
