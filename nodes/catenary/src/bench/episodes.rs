//! Simulated episodes that benchmarks measure or infer.

use crate::evaluate::episodes::as_measured;
use anyhow::{Context, Result};
use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Fidelity, GripTrajectory, Model, SimulationRequest, Simulator, seed};
use catenary_simulator::BeamSimulator;
use catenary_simulator::verification::random_hand_path;

/// Request for `count` episodes of 16 steps and 8 s over the table. Thetas and effects come from the model's own
/// distributions.
pub fn batch(model: &Model, fidelity: Fidelity, count: usize) -> Result<SimulationRequest> {
    // A fixed seed: two runs measure the same episodes.
    let mut rng = seed::rng(1, 0);
    let path = motion(model, 1)?;
    let o = model.observation;
    Ok(SimulationRequest {
        thetas: (0..count).map(|_| model.theta.sample_prior(&mut rng)).collect(),
        effects: Vec::new(),
        drive: Drive::Grip(path),
        start: StartShape::HangingAtRest,
        frame_times_s: (0..o.frames).map(|i| i as f64 * o.frame_period_s).collect(),
        target_m: None,
        fidelity,
        seed: 1,
        first_episode: 0,
        noise: true,
    })
}

fn motion(model: &Model, motion_seed: u64) -> Result<GripTrajectory> {
    random_hand_path(model, motion_seed).with_context(|| format!("model `{}` has no task", model.name))
}

/// Simulated episode of `truth` with a random motion and all noise, in the form of a measured one.
pub fn hidden_episode(model: &Model, truth: &[f64], episode_seed: u64, fidelity: Fidelity) -> Result<MeasuredTrack> {
    let path = motion(model, episode_seed)?;
    let mut request = batch(model, fidelity, 1)?;
    request.thetas = vec![truth.to_vec()];
    request.seed = seed::derive(episode_seed, 1);
    request.drive = Drive::Grip(path.clone());
    let track = BeamSimulator::new(model, 1)?.simulate(&request)?.remove(0);
    Ok(as_measured(format!("simulated episode {episode_seed}"), track, path, model))
}
