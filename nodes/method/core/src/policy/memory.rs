//! What a policy keeps of an episode, and the inputs that its network takes of it.

use crate::Observation;
use serde::{Deserialize, Serialize};

/// Inputs of a policy's network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Observes {
    /// Number of observations before the newest, 0 for none. With them a policy can find out in an episode what one observation hides, such as
    /// velocities and the object's stiffness.
    pub history: usize,
    /// True for the number of the step. Without it a policy whose goal is its last step cannot know how much of the motion is left.
    pub time: bool,
}

impl Observes {
    /// Number of inputs.
    pub fn count(&self) -> usize {
        Observation::LEN * (1 + self.history) + usize::from(self.time)
    }

    /// Appends the inputs at the newest observation of `memory` to `to`: the normalised values of each observation, the newest first, then the
    /// time, from -1 at the first of `steps` steps to 1 after the last.
    pub fn append_inputs(
        &self,
        memory: &Memory,
        steps: usize,
        mean: &[f32; Observation::LEN],
        scale: &[f32; Observation::LEN],
        to: &mut Vec<f32>,
    ) {
        to.extend(memory.newest_first.iter().flat_map(|o| normalised(o, mean, scale)));
        if self.time {
            to.push(2.0 * memory.step() as f32 / steps as f32 - 1.0);
        }
    }
}

/// Normalised observation: `(observation - mean) / max(scale, 1e-6)`, within +-10.
fn normalised(
    observation: &Observation,
    mean: &[f32; Observation::LEN],
    scale: &[f32; Observation::LEN],
) -> [f32; Observation::LEN] {
    // A component that hardly varied in training has a tiny scale: without the limit, a small change would be a huge input.
    std::array::from_fn(|i| ((observation.0[i] as f32 - mean[i]) / scale[i].max(1e-6)).clamp(-10.0, 10.0))
}

/// Observations of an episode that a policy still needs. The default is empty: the start of an episode.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    newest_first: Vec<Observation>,
    /// First observation of the episode.
    first: Observation,
    /// Number of observations so far.
    count: u64,
}

impl Memory {
    /// Adds the newest observation, and keeps it with the `history` ones before it. Where the episode has fewer, its first one stands for those
    /// that are missing. `history` is the same in all calls of an episode.
    pub fn see(&mut self, newest: &Observation, history: usize) {
        if self.count == 0 {
            self.first = *newest;
        }
        self.count += 1;
        self.newest_first.insert(0, *newest);
        self.newest_first.resize(1 + history, self.first);
    }

    /// Kept observations, the newest first; none before the first one.
    pub fn newest_first(&self) -> &[Observation] {
        &self.newest_first
    }

    /// First observation of the episode; zeros before it.
    pub fn first(&self) -> &Observation {
        &self.first
    }

    /// Number of the step that the newest observation belongs to, from 0.
    pub fn step(&self) -> usize {
        self.count.saturating_sub(1) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> Observation {
        Observation([x; 12])
    }

    #[test]
    fn a_history_starts_with_the_first_observation_and_the_newest_comes_first() {
        let mut memory = Memory::default();
        let mut seen = |x, history| {
            memory.see(&at(x), history);
            memory.newest_first().to_vec()
        };
        assert_eq!(seen(1.0, 2), [at(1.0), at(1.0), at(1.0)]);
        assert_eq!(seen(2.0, 2), [at(2.0), at(1.0), at(1.0)]);
        seen(3.0, 2);
        assert_eq!(seen(4.0, 2), [at(4.0), at(3.0), at(2.0)]);
        assert_eq!((memory.first(), memory.step()), (&at(1.0), 3));
        let mut short = Memory::default();
        short.see(&at(5.0), 0);
        assert_eq!(short.newest_first(), [at(5.0)]);
    }

    #[test]
    fn the_time_follows_the_observations_and_goes_from_minus_one_to_one() {
        let observes = Observes { history: 1, time: true };
        let mut memory = Memory::default();
        for (step, expected) in [-1.0, -0.5, 0.0, 0.5].into_iter().enumerate() {
            memory.see(&at(step as f64), 1);
            let mut inputs = Vec::new();
            observes.append_inputs(&memory, 4, &[0.0; 12], &[1.0; 12], &mut inputs);
            assert_eq!(inputs.len(), observes.count());
            assert_eq!((inputs[0], inputs[24]), (step as f32, expected));
        }
    }
}
