//! Conditions of one episode, and the draws that depend on its seed alone.

use catenary_core::task::Task;
use catenary_core::{SimulationRequest, seed};
use rand::RngExt;

/// Random streams of one episode. Their numbers are part of the results: a change gives other draws for the same seed.
pub(super) mod stream {
    pub const EFFECTS: u64 = 0;
    pub const CAMERA: u64 = 1;
    pub const TARGET: u64 = 2;
    pub const NOISE: u64 = 3;
    pub const START: u64 = 4;
    pub const DROPS: u64 = 5;
    pub const WRENCH: u64 = 6;
}

/// Conditions of one episode: everything in which it differs from another of its model.
#[derive(Debug, Clone, Copy)]
pub struct Conditions<'a> {
    /// Values of the model's inferred parameters.
    pub theta: &'a [f64],
    /// Further parameters by name. They override the model's own draws.
    pub effects: &'a [(String, f64)],
    /// Seed of the episode.
    pub seed: u64,
    /// True if camera jitter and keypoint noise are added.
    pub noise: bool,
    /// Target (x, z) in m; none means the model's target with its jitter.
    pub target_m: Option<[f64; 2]>,
}

impl<'a> Conditions<'a> {
    /// Returns the conditions of episode `index` of a request. `effects` are its [`effects_of`].
    pub(crate) fn of(request: &'a SimulationRequest, index: usize, effects: &'a [(String, f64)]) -> Self {
        Self {
            theta: &request.thetas[index],
            effects,
            seed: seed::derive(request.seed, request.first_episode + index as u64),
            noise: request.noise,
            target_m: request.target_m,
        }
    }
}

/// Returns the values of further parameters that a request gives its episode `index`.
pub(crate) fn effects_of(request: &SimulationRequest, index: usize) -> Vec<(String, f64)> {
    request.effects.iter().map(|(name, values)| (name.clone(), values[index])).collect()
}

/// Returns the target (x, z) in m of an episode of the given seed.
pub fn jittered_target(task: &Task, episode_seed: u64) -> [f64; 2] {
    let half = task.target_jitter_m;
    let mut rng = seed::rng(episode_seed, stream::TARGET);
    task.target_m.map(|v| if half > 0.0 { v + rng.random_range(-half..=half) } else { v })
}
