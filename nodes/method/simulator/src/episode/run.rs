//! One episode of a request.

use super::simulation::EpisodeSimulation;
use super::steps::{StopCriterion, given, verdict};
use catenary_core::policy::Memory;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{Judge, Track};
use std::ops::ControlFlow;

/// Runs one episode of a request, until [`StopCriterion`] stops it. `drive` moves the grip. Frames are taken at
/// `frame_times_s`; with actions and policies at every step instead.
pub fn run(
    simulation: &mut EpisodeSimulation,
    drive: &Drive,
    start: &StartShape,
    frame_times_s: &[f64],
    is_enough: StopCriterion<'_>,
) -> Result<Track, String> {
    let task = simulation.model().task;
    let need_task =
        || task.ok_or_else(|| format!("model `{}`: actions and policies need a task", simulation.model().name));
    match drive {
        Drive::Grip(path) => Ok(simulation.follow(path, start, frame_times_s, is_enough)),
        Drive::Actions(actions) => {
            let task = need_task()?;
            Ok(simulation.act(&task, is_enough, |step, _, _| given(&task, actions, step)))
        }
        Drive::Policy(policy) => {
            let task = need_task()?;
            let mut memory = Memory::default();
            let mut referee = Judge::new(task, simulation.model().camera.view).referee();
            Ok(simulation.act(&task, is_enough, |step, observation, arm| {
                // The first frame precedes any action, so that it is not judged.
                let end = if step > 0 { verdict(&task, &mut referee, arm, observation, step).end } else { None };
                let mut action = || (step < task.steps).then(|| policy.act(observation, &mut memory));
                end.map_or_else(|| ControlFlow::Continue(action()), ControlFlow::Break)
            }))
        }
    }
}
