//! Steps of a task: actions executed by the arm, the stop criterion, and the verdict after a step.

use crate::arm::ArmModel;
use catenary_core::task::{Moment, Phase, Referee, Task, Verdict};
use catenary_core::track::End;
use catenary_core::{Frame, GripPose, Observation, Track};
use std::ops::ControlFlow;

/// Stop criterion: true if the frames of an episode so far, newest last, are all that is asked for.
pub type StopCriterion<'a> = &'a dyn Fn(&[Frame]) -> bool;

/// Stop criterion of a whole episode: never stops.
pub fn never_stop(_: &[Frame]) -> bool {
    false
}

/// Pose of the grip as a function of time in s.
pub(crate) type Path<'a> = &'a dyn Fn(f64) -> GripPose;

/// Executes actions with `arm`, one per step of the task, at constant pitch of the hand. `frame_at` advances the object
/// to a time along the path of the grip and takes the frame there. `choose` gives the action after the newest frame, none
/// for a step of the rest, or the end of the episode.
pub(crate) fn execute(
    task: &Task,
    pitch_rad: f64,
    mut arm: ArmModel,
    mut frame_at: impl FnMut(f64, Path<'_>) -> Frame,
    mut choose: impl FnMut(usize, &ArmModel, &[Frame]) -> ControlFlow<End, Option<[f64; 2]>>,
) -> Track {
    let mut frames: Vec<Frame> = Vec::new();
    for step in 0.. {
        let time_s = step as f64 * task.step_period_s;
        arm.run_to(time_s);
        frames.push(frame_at(time_s, &|t| arm.grip(t, pitch_rad)));
        match choose(step, &arm, &frames) {
            ControlFlow::Continue(Some(action)) => {
                frames[step].action = action;
                arm.set_delta(time_s, action);
            }
            // A delta of zero would be a command, too: from a measured pose, it stops the arm on its way.
            ControlFlow::Continue(None) => {}
            ControlFlow::Break(end) => return Track { frames, end },
        }
    }
    unreachable!("the loop over steps has no end of its own")
}

/// Step `step` of an episode of given actions, which ends as complete after the rest of the task, if all of the task's
/// actions are given.
pub(crate) fn given(task: &Task, actions: &[[f64; 2]], step: usize) -> ControlFlow<End, Option<[f64; 2]>> {
    match actions.get(step) {
        Some(action) => ControlFlow::Continue(Some(*action)),
        None if step < actions.len() + task.rest_after(actions.len()) => ControlFlow::Continue(None),
        None => ControlFlow::Break(End::Complete),
    }
}

/// Makes a frame without an action.
pub(crate) fn frame(time_s: f64, dlo: [[f64; 2]; 4], target: [f64; 2], grip: GripPose) -> Frame {
    Frame { time_s, dlo, target, eef: [grip.x_m, grip.z_m, grip.pitch_rad], action: [0.0; 2], wrench: None }
}

/// Judges an observation after a step.
pub fn verdict(task: &Task, referee: &mut Referee, arm: &ArmModel, observation: &Observation, step: usize) -> Verdict {
    // The commanded target counts too: an arm that is sent out of the workspace has not left it yet.
    let left = !task.allows(observation.eef_m()) || !task.allows(arm.target_m());
    referee.verdict(&Moment::of(observation, left, Phase::of(step, task.steps, task.rest_steps)))
}
