//! Aim of a task in words.

use catenary_core::{Goal, Task};

/// Place, time and distance of a success in a sentence. `success_distance_m` is that of the task's judge.
pub fn of(task: &Task, success_distance_m: f64) -> String {
    let mm = format!("{:.0} mm", 1e3 * success_distance_m);
    let seconds = task.steps as f64 * task.step_period_s;
    let rest_s = task.rest_steps as f64 * task.step_period_s;
    match task.goal {
        Goal::Reach => format!(
            "Success: at one of {} steps the object's four keypoints are near the target, {mm} in the root mean square. \
             The position of the hand does not count.",
            task.steps
        ),
        Goal::PlaceTip { .. } => format!(
            "Success: when the motion of {seconds} s ends, the free end of the object (its outermost keypoint) is within {mm} \
             of the target, as the camera sees both. The position of the hand does not count."
        ),
        Goal::Settle { .. } => format!(
            "Success: after a motion of {seconds} s and {rest_s} s of rest, the hand is above the target and the object was still: \
             the horizontal distance of the hand and the root mean square motion of the free end in the rest are together below {mm}."
        ),
        Goal::Whip { .. } => format!(
            "Success: at one of {} steps the free end of the object (its outermost keypoint) is within {mm} of the target, \
             as the camera sees both. The position of the hand does not count.",
            task.steps
        ),
        Goal::Lay { .. } => format!(
            "Success: after a motion of {seconds} s and {rest_s} s of rest, the outer half of the object lies at the height of the target \
             with its free end there: both are together within {mm}."
        ),
    }
}

/// Part of the object whose distance the task counts.
pub fn part(goal: &Goal) -> &'static str {
    match goal {
        Goal::Reach => "keypoints",
        Goal::PlaceTip { .. } | Goal::Whip { .. } => "tip",
        Goal::Settle { .. } => "hand and tip",
        Goal::Lay { .. } => "outer half",
    }
}
