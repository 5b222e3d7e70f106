//! Random motions of the hand.

use crate::arm::ArmModel;
use crate::episode_model::ArmSettings;
use catenary_core::{GripTrajectory, Model, Task, seed};
use rand::RngExt;

/// Random stream of the motions.
const STREAM: u64 = 31;
const SAMPLES_PER_STEP: usize = 500;
/// Distance in m of targets from the workspace's edge.
const MARGIN_M: f64 = 0.01;
/// Largest move along an axis in m, and mean fall of a step in m.
// With this fall, half of the moves over a table end low.
const MOVE_M: f64 = 0.06;
const FALL_M: f64 = 0.01;

/// Returns the path of a hand that makes a random action in each step of the model's task, within the workspace. None
/// if the model has no task.
pub fn random_hand_path(model: &Model, motion_seed: u64) -> Option<GripTrajectory> {
    random_motion(model, &ArmSettings::new(model.arm.law, model.delta_anchor()), motion_seed).map(|motion| motion.0)
}

/// Returns the actions (dx, dz) in m of [`random_hand_path`]. None if the model has no task.
pub fn random_actions(model: &Model, motion_seed: u64) -> Option<Vec<[f64; 2]>> {
    random_motion(model, &ArmSettings::new(model.arm.law, model.delta_anchor()), motion_seed).map(|motion| motion.1)
}

/// Returns the path of a hand that makes these actions, with the rest of the task if they are all of its actions. None if the
/// model has no task.
pub fn path_of_actions(model: &Model, actions: &[[f64; 2]]) -> Option<GripTrajectory> {
    let task = model.task?;
    let steps = actions.len() + task.rest_after(actions.len());
    let arm = ArmSettings::new(model.arm.law, model.delta_anchor());
    path(model, &task, &arm, steps, |step, _| actions.get(step).copied())
}

/// Returns path and actions for an arm with other settings.
pub(super) fn random_motion(
    model: &Model,
    arm: &ArmSettings,
    motion_seed: u64,
) -> Option<(GripTrajectory, Vec<[f64; 2]>)> {
    let task = model.task?;
    let mut rng = seed::rng(motion_seed, STREAM);
    let mut actions = Vec::new();
    let path = path(model, &task, arm, task.steps, |_, [x, z]| {
        let within = |v: f64, [low, high]: [f64; 2], by: f64| (v + by).clamp(low + MARGIN_M, high - MARGIN_M) - v;
        let (a, b) = (rng.random_range(-MOVE_M..MOVE_M), rng.random_range(-MOVE_M..MOVE_M));
        let delta_m = [within(x, task.workspace.x_m, a), within(z, task.workspace.z_m, b - FALL_M)];
        actions.push(delta_m);
        Some(delta_m)
    });
    path.map(|path| (path, actions))
}

/// Path of a hand over some steps of a task. `choose` gives the action of a step from its number and the arm's target (x, z) in m; none
/// keeps the target.
fn path(
    model: &Model,
    task: &Task,
    arm: &ArmSettings,
    steps: usize,
    mut choose: impl FnMut(usize, [f64; 2]) -> Option<[f64; 2]>,
) -> Option<GripTrajectory> {
    let start = model.arm.start;
    let mut arm = ArmModel::new(arm, [start.x_m, start.z_m]);
    let (mut times_s, mut poses) = (Vec::new(), Vec::new());
    for step in 0..steps {
        let from_s = step as f64 * task.step_period_s;
        if let Some(delta_m) = choose(step, arm.target_m()) {
            arm.set_delta(from_s, delta_m);
        }
        for i in 0..SAMPLES_PER_STEP {
            let time_s = from_s + task.step_period_s * i as f64 / SAMPLES_PER_STEP as f64;
            arm.run_to(time_s);
            times_s.push(time_s);
            poses.push(arm.grip(time_s, start.pitch_rad));
        }
    }
    GripTrajectory::new(times_s, poses).ok()
}
