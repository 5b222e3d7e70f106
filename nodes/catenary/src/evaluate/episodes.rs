//! Simulated episodes that policies are evaluated on.

use catenary_core::episode::MeasuredTrack;
use catenary_core::simulator::StartShape;
use catenary_core::{Drive, Fidelity, GripTrajectory, Model, SimulationRequest, Task, Track};

/// Simulated episode in the form of a measured one, along the exact path of the hand.
pub fn as_measured(name: String, track: Track, grip: GripTrajectory, model: &Model) -> MeasuredTrack {
    let target_m = track.frames.first().and_then(|f| model.camera.view.plane_from_scaled(f.target));
    MeasuredTrack {
        name,
        track,
        grip,
        actions: Vec::new(),
        start: StartShape::HangingAtRest,
        target_m,
        warnings: Vec::new(),
    }
}

/// The model, with a task that no success ends: all returns then sum over the same number of steps. An episode still ends if the arm
/// leaves its workspace.
pub fn without_early_success(model: &Model) -> Model {
    let task = model.task.map(|task| Task { ends_at_success: false, ..task });
    Model { task, ..model.clone() }
}

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
