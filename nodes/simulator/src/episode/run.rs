//! One episode of a request.

use super::simulation::EpisodeSimulation;
use super::steps::StopCriterion;
use catenary_core::Track;
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::track::End;

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
            Ok(simulation.act(&task, false, is_enough, |step, _| actions.get(step).copied()))
        }
        Drive::Policy(policy) => {
            let task = need_task()?;
            let mut track =
                simulation.act(&task, true, is_enough, |step, o| (step < task.steps).then(|| policy.act(o)));
            if track.end == End::Complete {
                // A policy has no end of its own: it ran into the task's last step.
                track.end = End::StepLimit;
            }
            Ok(track)
        }
    }
}
