//! Figures of the control loop, counted without an allocation.

use catenary_core::durations::Durations;
use std::time::Duration;

/// Computing times of the cycles, and lost states.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoopFigures {
    /// Computing times of the cycles of all motions, from the arrival of a state to its torques.
    pub computing: Durations,
    /// States that did not arrive, by the robot's clock.
    pub lost_states: u64,
}

impl LoopFigures {
    /// Adds a cycle: its computing time, and the time between its state and the last one by the robot's clock, ms.
    pub fn add(&mut self, computing: Duration, period_ms: u64) {
        self.computing.add(computing);
        self.lost_states += period_ms.saturating_sub(1);
    }
}
