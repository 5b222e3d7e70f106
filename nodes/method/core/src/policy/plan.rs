//! Open-loop plan: actions that depend on the target alone.

use super::Memory;
use serde::{Deserialize, Serialize};

/// Open-loop plan: the action of each step is affine in the target as the first observation of the episode has it. Nothing that is seen later
/// changes it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Plan {
    /// For each step and for dx and dz: the constant, and the factors of the target's x and y (scaled to -1 .. 1 over the image), in units of
    /// the action limit. The steps after the last one have no action.
    pub steps: Vec<[[f32; 3]; 2]>,
}

impl Plan {
    /// Action (dx, dz) at the newest observation of `memory`, in units of the action limit, not limited.
    pub fn action(&self, memory: &Memory) -> [f32; 2] {
        let [x, y] = memory.first().target().map(|v| v as f32);
        self.steps.get(memory.step()).map_or([0.0; 2], |rows| rows.map(|[c, by_x, by_y]| c + by_x * x + by_y * y))
    }

    /// All numbers, step by step.
    pub fn numbers(&self) -> Vec<f32> {
        self.steps.iter().flatten().flatten().copied().collect()
    }

    /// Plan of all its numbers, step by step: six for each step.
    pub fn of_numbers(numbers: &[f32]) -> Self {
        let row = |n: &[f32]| [n[0], n[1], n[2]];
        Self { steps: numbers.chunks_exact(6).map(|n| [row(&n[..3]), row(&n[3..])]).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Observation;

    #[test]
    fn actions_follow_the_target_as_it_was_seen_first() {
        let plan = Plan::of_numbers(&[0.5, 1.0, 0.0, 0.0, 0.0, -2.0, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(Plan::of_numbers(&plan.numbers()), plan);
        let seen = |target| Observation::new([0.4, 0.3], &[[0.0; 2]; 4], target);
        let mut memory = Memory::default();
        memory.see(&seen([0.25, 0.5]), 0);
        assert_eq!(plan.action(&memory), [0.75, -1.0]);
        memory.see(&seen([0.9, 0.9]), 0);
        assert_eq!(plan.action(&memory), [0.25, 0.0]);
        memory.see(&seen([0.9, 0.9]), 0);
        assert_eq!(plan.action(&memory), [0.0, 0.0], "after its last step a plan stands still");
    }
}
