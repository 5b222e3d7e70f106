//! Simulated episodes that policies are evaluated on.

use catenary_core::simulator::StartShape;
use catenary_core::{Drive, Fidelity, SimulationRequest};

/// Request for noisy episodes of these thetas from the model's start, with an empty drive.
pub fn episodes(thetas: Vec<Vec<f64>>, fidelity: Fidelity, seed: u64) -> SimulationRequest {
    SimulationRequest {
        thetas,
        effects: Vec::new(),
        drive: Drive::Actions(Vec::new()),
        start: StartShape::HangingAtRest,
        frame_times_s: Vec::new(),
        target_m: None,
        fidelity,
        seed,
        first_episode: 0,
        noise: true,
    }
}
