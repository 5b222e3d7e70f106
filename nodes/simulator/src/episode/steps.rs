//! Steps of a task: actions executed by the arm, the stop criterion, and the verdict after a step.

use crate::arm::ArmModel;
use catenary_core::task::{Judge, Moment, Task, Verdict};
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
/// to a time along the path of the grip and takes the frame there. `choose` gives the action after the newest frame, or
/// the end of the episode.
pub(crate) fn execute(
    task: &Task,
    pitch_rad: f64,
    mut arm: ArmModel,
    mut frame_at: impl FnMut(f64, Path<'_>) -> Frame,
    mut choose: impl FnMut(usize, &ArmModel, &[Frame]) -> ControlFlow<End, [f64; 2]>,
) -> Track {
    let mut frames: Vec<Frame> = Vec::new();
    for step in 0.. {
        let time_s = step as f64 * task.step_period_s;
        arm.run_to(time_s);
        frames.push(frame_at(time_s, &|t| arm.grip(t, pitch_rad)));
        match choose(step, &arm, &frames) {
            ControlFlow::Continue(action) => {
                frames[step].action = action;
                arm.set_delta(time_s, action);
            }
            ControlFlow::Break(end) => return Track { frames, end },
        }
    }
    unreachable!("the loop over steps has no end of its own")
}

/// Continues with the action, or ends the episode as complete if there is none.
pub(crate) fn or_complete(action: Option<[f64; 2]>) -> ControlFlow<End, [f64; 2]> {
    action.map_or(ControlFlow::Break(End::Complete), ControlFlow::Continue)
}

/// Makes a frame without an action.
pub(crate) fn frame(time_s: f64, dlo: [[f64; 2]; 4], target: [f64; 2], grip: GripPose) -> Frame {
    Frame { time_s, dlo, target, eef: [grip.x_m, grip.z_m, grip.pitch_rad], action: [0.0; 2] }
}

/// Judges an observation after a step. `is_last` marks the last step.
pub fn verdict(judge: &Judge, arm: &ArmModel, observation: &Observation, is_last: bool) -> Verdict {
    // The commanded target counts too: an arm that is sent out of the workspace has not left it yet.
    let left = !judge.task().allows(observation.eef_m()) || !judge.task().allows(arm.target_m());
    judge.verdict(&Moment::of(observation, left, is_last))
}
