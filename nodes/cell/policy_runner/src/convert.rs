//! Conversions between messages and the types of the runner.

use crate::runner::{Inputs, Objection, Settings, Step, StillProgress};
use catenary_core::Keypoints;
use catenary_core::task::DeltaAnchor;
use catenary_msgs::action::{RunEpisodeFeedback, RunEpisodeGoal};
use catenary_msgs::geometry_msgs::msg::{Pose, PoseStamped};
use catenary_msgs::msg::{AcceptedTarget, ArmState, EefDelta, EpisodeEvent, Keypoints as KeypointsMsg, Observation};
use catenary_shell::{Flaw, Time, convert, stamp};

/// Tolerated deviation of a quaternion's norm from 1: single precision and rounding to a few digits pass.
const NORM_TOLERANCE: f64 = 0.01;
/// Frame of targets and actions.
const BASE_FRAME: &str = "panda_link0";

/// Makes the runner's inputs from the newest messages. Times are s since `origin`. Invalid keypoints count as missing.
pub fn inputs(
    origin: Time,
    now: Time,
    keypoints: Option<&KeypointsMsg>,
    pose: Option<&PoseStamped>,
    arm: Option<&ArmState>,
) -> Inputs {
    let since = |header: &catenary_msgs::std_msgs::msg::Header| stamp::from_msg(&header.stamp).secs_since(origin);
    let keypoints = keypoints.and_then(|k| Some((since(&k.header), placed(k)?)));
    let pose = pose.map(|p| (since(&p.header), convert::grip_pose_from_msg(&p.pose)));
    Inputs {
        now_s: now.secs_since(origin),
        keypoints,
        pose,
        arm_fault: arm_fault(arm),
        objection: None,
        stranger: None,
    }
}

/// Checks keypoints.
///
/// # Errors
/// [`Flaw`] of the invalid field.
pub fn check_keypoints(message: &KeypointsMsg) -> Result<(), Flaw> {
    convert::keypoints_from_msg(message).map(drop).map_err(|error| Flaw::new(error.field, error))
}

/// Checks a pose: frame, finite numbers, unit quaternion.
///
/// # Errors
/// [`Flaw`] of the invalid property.
pub fn check_pose(message: &PoseStamped) -> Result<(), Flaw> {
    let (frame, p, q) = (&message.header.frame_id, &message.pose.position, &message.pose.orientation);
    if frame != BASE_FRAME {
        return Err(Flaw::new("frame", format!("expected frame `{BASE_FRAME}`, got `{frame}`")));
    }
    if ![p.x, p.y, p.z, q.x, q.y, q.z, q.w].iter().all(|v| v.is_finite()) {
        return Err(Flaw::new("not finite", format!("expected finite numbers, got {:?}", message.pose)));
    }
    let norm = [q.x, q.y, q.z, q.w].iter().map(|v| v * v).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err(Flaw::new("quaternion", format!("expected a unit quaternion, got one of norm {norm:.3}")));
    }
    Ok(())
}

fn placed(message: &KeypointsMsg) -> Option<Keypoints> {
    convert::keypoints_from_msg(message).inspect_err(|e| tracing::warn!("keypoints: {e}")).ok()
}

/// Returns the reason why the arm cannot be commanded; `None` if it can.
pub fn arm_fault(arm: Option<&ArmState>) -> Option<String> {
    let Some(arm) = arm else { return Some("no arm_state message was received".to_owned()) };
    let why = match arm.mode {
        ArmState::MODE_TRACKING | ArmState::MODE_HOLD => return None,
        ArmState::MODE_IDLE => "it is not enabled",
        ArmState::MODE_MOVING => "it is moving to the start",
        ArmState::MODE_REFLEX => "a reflex is latched",
        ArmState::MODE_USER_STOP => "the user stop is pressed",
        _ => "it is not connected",
    };
    Some(if arm.fault.is_empty() { why.to_owned() } else { format!("{why}: {}", arm.fault) })
}

/// State of the arm, if it was measured after `since`. The newest state that was received may lag behind the answer of a service or action, which
/// travels apart from it. A lost connection counts always: no state is measured any more.
pub fn measured_after(arm: Option<&ArmState>, since: Time) -> Option<&ArmState> {
    arm.filter(|arm| arm.mode == ArmState::MODE_DISCONNECTED || stamp::from_msg(&arm.header.stamp) > since)
}

/// Returns the reason why an arm that is not enabled yet may not be: a stop, a reflex, another motion, a lost connection. None if it may, or if
/// nothing was heard of it yet.
pub fn arm_stopped(arm: Option<&ArmState>) -> Option<String> {
    arm.filter(|arm| arm.mode != ArmState::MODE_IDLE).and_then(|arm| arm_fault(Some(arm)))
}

/// Returns the gate's objection to the target that it answers; `None` if it took the target unchanged.
pub fn objection(answer: &AcceptedTarget) -> Option<Objection> {
    if !answer.accepted {
        return Some(Objection::Rejected(answer.reason.clone()));
    }
    (answer.clipped_x || answer.clipped_y || answer.clipped_z).then_some(Objection::Clipped)
}

/// Makes the feedback of an episode that waits.
pub fn waiting(progress: &StillProgress) -> RunEpisodeFeedback {
    RunEpisodeFeedback {
        waiting: true,
        waited: progress.waited_s,
        motion: progress.motion_px.unwrap_or(f64::NAN),
        motion_limit: progress.limit_px,
        remaining: progress.remaining_s.unwrap_or(f64::NAN),
        ..RunEpisodeFeedback::default()
    }
}

/// Makes the feedback of a step of an episode, with its reward.
pub fn rewarded(step: u32, reward: f64) -> RunEpisodeFeedback {
    RunEpisodeFeedback { step, reward, ..RunEpisodeFeedback::default() }
}

/// Reads the wait of an episode from its feedback; none once the episode runs.
pub fn progress(feedback: &RunEpisodeFeedback) -> Option<StillProgress> {
    let known = |value: f64| value.is_finite().then_some(value);
    feedback.waiting.then(|| StillProgress {
        waited_s: feedback.waited,
        motion_px: known(feedback.motion),
        limit_px: feedback.motion_limit,
        remaining_s: known(feedback.remaining),
    })
}

/// Merges the settings of a goal into the node's own.
pub fn settings(goal: &RunEpisodeGoal, own: Settings) -> Settings {
    Settings {
        run_all_steps: goal.run_all_steps,
        stochastic_seed: goal.stochastic.then_some(goal.seed),
        max_steps: (goal.max_steps > 0).then_some(goal.max_steps as usize),
        ..own
    }
}

/// Makes the message of a step's observation.
pub fn observation(step: &Step, episode: u32, origin: Time, now: Time) -> Observation {
    let stamped = |s: f64| stamp::to_msg(origin + std::time::Duration::from_secs_f64(s.max(0.0)));
    Observation {
        header: stamp::header(now, BASE_FRAME),
        episode,
        step: step.index as u32,
        values: step.observation.0,
        keypoints_stamp: stamped(step.stamps_s[0]),
        pose_stamp: stamped(step.stamps_s[1]),
    }
}

/// Makes the message of a step's action, `delta` in m.
pub fn action(step: &Step, delta: [f64; 2], episode: u32, anchor: DeltaAnchor, now: Time) -> EefDelta {
    EefDelta {
        header: stamp::header(now, BASE_FRAME),
        episode,
        step: step.index as u32,
        dx: delta[0],
        dz: delta[1],
        anchor: convert::anchor_to_msg(anchor),
    }
}

/// Makes the target pose of the arm: x and z from `target_m`, y and orientation from `held`, the pose at the start.
pub fn target(target_m: [f64; 2], held: &Pose, now: Time) -> PoseStamped {
    // The policy moves in the plane. y and orientation keep the values of the hand at the start of the episode.
    let mut pose = held.clone();
    (pose.position.x, pose.position.z) = (target_m[0], target_m[1]);
    PoseStamped { header: stamp::header(now, BASE_FRAME), pose }
}

/// Makes an event of an episode without its kind, reason and counts.
pub fn event(episode: u32, policy: &catenary_core::Policy, name: &str, seed: u64, now: Time) -> EpisodeEvent {
    EpisodeEvent {
        header: stamp::header(now, ""),
        episode,
        policy: name.to_owned(),
        seed,
        step_period: policy.step_period_s,
        anchor: convert::anchor_to_msg(policy.delta_anchor),
        ..EpisodeEvent::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_msgs::geometry_msgs::msg::{Point, Quaternion};

    #[test]
    fn invalid_poses_are_refused_by_kind() {
        let orientation = Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 };
        let pose = Pose { position: Point { x: 0.4, y: 0.0, z: 0.4 }, orientation };
        let good = PoseStamped { header: stamp::header(Time::from_nanos(5), BASE_FRAME), pose };
        let kind = |change: fn(&mut PoseStamped)| {
            let mut bad = good.clone();
            change(&mut bad);
            check_pose(&bad).err().map(|flaw| flaw.kind)
        };
        assert_eq!(kind(|_| {}), None);
        assert_eq!(kind(|p| p.header.frame_id = "world".into()), Some("frame"));
        assert_eq!(kind(|p| p.pose.position.z = f64::NAN), Some("not finite"));
        assert_eq!(kind(|p| p.pose.orientation.x = 0.5), Some("quaternion"));
    }

    #[test]
    fn a_stop_ends_a_wait_and_an_arm_that_is_not_enabled_does_not() {
        let of = |mode| arm_stopped(Some(&ArmState { mode, ..ArmState::default() }));
        for mode in [ArmState::MODE_IDLE, ArmState::MODE_HOLD, ArmState::MODE_TRACKING] {
            assert_eq!(of(mode), None);
        }
        for mode in [ArmState::MODE_MOVING, ArmState::MODE_REFLEX, ArmState::MODE_USER_STOP] {
            assert!(of(mode).is_some(), "{mode}");
        }
        assert_eq!(arm_stopped(None), None);
    }

    #[test]
    fn a_state_counts_after_a_time_and_a_lost_connection_always() {
        let at =
            |mode, nanos| ArmState { mode, header: stamp::header(Time::from_nanos(nanos), ""), ..ArmState::default() };
        for (mode, nanos, counts) in [
            (ArmState::MODE_MOVING, 4, false),
            (ArmState::MODE_MOVING, 5, false),
            (ArmState::MODE_MOVING, 6, true),
            (ArmState::MODE_TRACKING, 0, false),
            (ArmState::MODE_DISCONNECTED, 0, true),
        ] {
            let state = at(mode, nanos);
            assert_eq!(measured_after(Some(&state), Time::from_nanos(5)).is_some(), counts, "{mode} at {nanos}");
        }
        assert!(measured_after(None, Time::from_nanos(5)).is_none());
    }

    #[test]
    fn a_target_keeps_y_and_orientation_of_the_hand() {
        // Half a turn about x, because the hand points down, and 0.25 rad of yaw.
        let orientation = Quaternion { x: 0.992_198, y: 0.124_675, z: 0.0, w: 0.0 };
        let held = Pose { position: Point { x: 0.4, y: 0.03, z: 0.42 }, orientation: orientation.clone() };
        let target = target([0.45, 0.38], &held, Time::from_nanos(5));
        assert_eq!(target.pose.position, Point { x: 0.45, y: 0.03, z: 0.38 });
        assert_eq!(target.pose.orientation, orientation);
        assert_eq!(target.header.frame_id, BASE_FRAME);
    }
}
