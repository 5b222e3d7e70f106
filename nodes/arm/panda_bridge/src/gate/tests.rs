//! Tests of the gate, one per rule.

use super::*;

const RUNNER: Writer = [1; 16];
const STRANGER: Writer = [2; 16];

fn pose(x: f64) -> ArmPose {
    ArmPose { position_m: [x, 0.0, 0.3], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] }
}

fn command(x: f64) -> Command {
    Command { writer: RUNNER, age_s: 0.01, simulated_time: false, frame_id: BASE_FRAME.into(), pose: pose(x) }
}

/// Graph with this number of publishers of targets.
fn rivals(count: usize) -> Rivals {
    let publishers = ["/policy_runner", "/stranger"].into_iter().take(count).map(str::to_owned).collect();
    Rivals { publishers, writer: (count == 1).then_some(RUNNER), ..Rivals::default() }
}

fn of_stranger(x: f64) -> Command {
    Command { writer: STRANGER, ..command(x) }
}

/// Gate in an episode, enabled, with the arm measured at x = 0.4 m.
fn gate() -> SafetyGate {
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    g.on_enable(&rivals(1), false).unwrap();
    g.on_episode_started(0.1, 9.0).unwrap();
    g
}

fn rejected(g: &mut SafetyGate, c: &Command) -> Rejection {
    let before = g.target();
    let Verdict::Rejected(r) = g.on_command(c, 10.0) else { panic!("accepted {c:?}") };
    assert_eq!(g.target(), before, "a rejected command changes nothing");
    assert_eq!(g.counts().1, 1, "it is counted");
    r
}

#[test]
fn a_good_command_becomes_the_target() {
    let mut g = gate();
    assert_eq!(g.on_command(&command(0.45), 10.0), Verdict::Accepted { pose: pose(0.45), clip: Clip::default() });
    assert_eq!((g.mode(), g.target(), g.counts()), (Mode::Tracking, Some(pose(0.45)), (1, 0)));
}

#[test]
fn nan_is_rejected() {
    let mut c = command(0.4);
    c.pose.position_m[1] = f64::NAN;
    assert_eq!(rejected(&mut gate(), &c), Rejection::NotFinite);
    let c = Command { age_s: f64::NAN, ..command(0.4) };
    assert!(matches!(rejected(&mut gate(), &c), Rejection::Stale { .. }));
}

#[test]
fn an_unnormalised_quaternion_is_rejected() {
    let mut c = command(0.4);
    c.pose.quaternion_xyzw = [0.9, 0.0, 0.0, 0.0];
    assert_eq!(rejected(&mut gate(), &c), Rejection::NotNormalised);
}

#[test]
fn another_frame_is_rejected() {
    let c = Command { frame_id: "world".into(), ..command(0.4) };
    assert_eq!(rejected(&mut gate(), &c), Rejection::Frame("world".into()));
}

#[test]
fn a_stale_stamp_and_one_from_the_future_are_rejected() {
    for age_s in [0.3, -0.3] {
        let c = Command { age_s, ..command(0.4) };
        assert!(matches!(rejected(&mut gate(), &c), Rejection::Stale { .. }));
    }
}

#[test]
fn a_jump_or_a_turn_from_the_measured_pose_is_rejected() {
    assert!(matches!(rejected(&mut gate(), &command(0.501)), Rejection::Jump { .. }));
    let mut c = command(0.4);
    let turned = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.31, 0.0) * c.pose.rotation();
    c.pose = ArmPose::from_parts(c.pose.position_m, &turned);
    assert!(matches!(rejected(&mut gate(), &c), Rejection::Jump { .. }));
}

#[test]
fn beside_two_publishers_it_neither_enables_nor_moves_to_the_start() {
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    assert_eq!(g.on_enable(&rivals(2), false), Err(Refusal::Publishers(rivals(2).publishers)));
    assert_eq!(g.on_move_begins(&rivals(2), false), Err(Refusal::Publishers(rivals(2).publishers)));
    assert_eq!(g.mode(), Mode::Idle);
}

#[test]
fn a_publisher_that_comes_later_ends_the_motion() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    assert_eq!((g.on_rivals(&rivals(1)), g.mode()), (None, Mode::Tracking));
    assert_eq!((g.on_rivals(&rivals(2)), g.mode()), (Some(Order::End), Mode::Idle));
    assert!(g.fault().contains("2 publishers"), "{}", g.fault());
    assert_eq!((g.on_rivals(&rivals(2)), g.on_unready("gone")), (None, None), "an idle arm has nothing to end");
    let mut g = gate();
    g.on_move_begins(&rivals(1), false).unwrap();
    assert_eq!((g.on_rivals(&rivals(2)), g.mode()), (Some(Order::End), Mode::Idle), "nor does it go on to the start");
    let mut g = gate();
    g.on_move_begins(&rivals(1), false).unwrap();
    assert_eq!((g.on_unready("gone"), g.mode(), g.fault()), (Some(Order::End), Mode::Idle, "gone"));
}

#[test]
fn beside_another_arm_of_the_same_names_it_neither_enables_nor_moves_and_names_that_arm() {
    let lab_arm = vec!["/lab_arm (process 7)".to_owned()];
    let serving = Rivals { servers: lab_arm.clone(), ..Rivals::default() };
    let telling = Rivals { arms: lab_arm, ..Rivals::default() };
    for beside in [serving, telling] {
        let mut g = SafetyGate::new(GateSettings::default(), false);
        g.on_measured(pose(0.4));
        for refused in [g.on_enable(&beside, false).map(|_| ()), g.on_move_begins(&beside, false)] {
            let words = refused.unwrap_err().to_string();
            assert!(words.contains("/lab_arm (process 7)") && words.contains("ROS_DOMAIN_ID"), "{words}");
        }
        assert_eq!(g.mode(), Mode::Idle);
        g.on_enable(&rivals(1), false).unwrap();
        assert_eq!((g.on_rivals(&beside), g.mode()), (Some(Order::End), Mode::Idle));
    }
}

#[test]
fn nothing_is_accepted_before_it_is_enabled() {
    let mut g = SafetyGate::new(GateSettings::default(), true);
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::NoPose));
    g.on_measured(pose(0.4));
    assert!(matches!(g.on_command(&command(0.4), 10.0), Verdict::Rejected(Rejection::NotEnabled(_))));
}

#[test]
fn silence_in_an_episode_holds_at_the_measured_pose_and_then_ends_the_motion() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    g.on_measured(pose(0.43));
    assert_eq!(g.tick(10.2), None);
    // The defaults hold after 0.25 s and end the motion after 2 s.
    assert_eq!(g.tick(10.26), Some(Order::Hold(pose(0.43))));
    assert_eq!((g.mode(), g.target()), (Mode::Hold, Some(pose(0.43))));
    assert_eq!(g.tick(11.9), None);
    assert_eq!(g.tick(12.01), Some(Order::End));
    assert_eq!(g.mode(), Mode::Idle);
}

#[test]
fn a_slow_policy_is_not_silent_between_its_steps() {
    let mut g = gate();
    g.on_episode_started(0.5, 9.0).unwrap();
    g.on_command(&command(0.45), 10.0);
    // 1.5 steps of 0.5 s are 0.75 s, more than the 0.25 s of quick policies.
    assert_eq!(g.tick(10.6), None);
    assert!(g.tick(10.76).is_some());
}

#[test]
fn an_episode_announced_after_its_first_target_is_watched() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    g.on_episode_started(0.1, 10.001).unwrap();
    assert_eq!(g.tick(10.26), Some(Order::Hold(pose(0.4))));
    assert_eq!(g.tick(12.1), Some(Order::End));
}

#[test]
fn an_episode_without_a_target_ends_the_motion() {
    let mut g = gate();
    assert_eq!(g.tick(10.9), None);
    assert_eq!(g.tick(11.1), Some(Order::End));
}

#[test]
fn no_step_period_disables_the_silence_timeout() {
    for period_s in [f64::INFINITY, f64::NAN, -1.0, 0.0, 1e9, 2.1] {
        let mut g = gate();
        assert!(g.on_episode_started(period_s, 9.0).is_err(), "{period_s}");
        g.on_command(&command(0.45), 10.0);
        assert!(matches!(g.tick(10.26), Some(Order::Hold(_))), "{period_s}");
    }
    let mut g = gate();
    g.on_episode_started(2.0, 9.0).unwrap();
    g.on_command(&command(0.45), 10.0);
    assert_eq!(g.tick(12.5), None, "a slow policy within the limit");
}

#[test]
fn a_new_episode_does_not_undo_the_end_of_the_last() {
    let mut g = gate();
    g.on_measured(pose(0.55));
    g.on_command(&command(0.62), 10.0);
    g.on_episode_started(0.1, 10.0).unwrap();
    let next = g.on_command(&command(0.55), 10.1);
    assert!(matches!(next, Verdict::Rejected(Rejection::EpisodeOver(_))), "{next:?}");
}

#[test]
fn silence_outside_an_episode_is_no_fault() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    g.on_episode_ended();
    assert_eq!(g.tick(100.0), None);
    assert_eq!(g.target(), Some(pose(0.45)));
}

#[test]
fn targets_are_due_while_an_enabled_arm_follows_an_episode() {
    let mut g = gate();
    assert!(g.awaits_targets());
    g.on_episode_ended();
    assert!(!g.awaits_targets());
    g.on_episode_started(0.1, 9.0).unwrap();
    assert!(g.awaits_targets());
    g.on_disable();
    assert!(!g.awaits_targets());
}

#[test]
fn leaving_the_box_clamps_the_command_and_ends_the_episode() {
    let mut g = gate();
    g.on_measured(pose(0.55));
    let Verdict::Accepted { pose: clamped, clip } = g.on_command(&command(0.62), 10.0) else { panic!("rejected") };
    assert_eq!((clamped.position_m[0], clip), (0.6, Clip { x: true, y: false, z: false }));
    let next = g.on_command(&command(0.55), 10.1);
    assert!(matches!(next, Verdict::Rejected(Rejection::EpisodeOver(_))), "{next:?}");
    g.on_enable(&rivals(1), false).unwrap();
    assert!(matches!(g.on_command(&command(0.55), 10.2), Verdict::Accepted { .. }));
}

#[test]
fn a_clamped_target_may_be_no_jump_either() {
    let at = |z: f64| ArmPose { position_m: [0.4, 0.0, z], ..pose(0.4) };
    let to = |z: f64| Command { pose: at(z), ..command(0.4) };
    let mut g = gate();
    g.on_measured(at(0.85));
    assert!(matches!(rejected(&mut g, &to(0.82)), Rejection::FarOutside { distance_m, .. } if distance_m > 0.34));
    let mut g = gate();
    g.on_measured(at(0.55));
    let back = g.on_command(&to(0.52), 10.0);
    assert!(matches!(back, Verdict::Accepted { pose, .. } if pose == at(0.5)), "{back:?}");
}

#[test]
fn a_reflex_latches_until_it_is_recovered_and_recovery_seeds_from_the_measured_pose() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    assert_eq!(g.on_reflex("cartesian_reflex"), Order::End);
    assert_eq!(g.mode(), Mode::Reflex);
    assert!(matches!(g.on_command(&command(0.45), 10.0), Verdict::Rejected(Rejection::NotEnabled(_))));
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::Latched("reflex")));
    assert_eq!(g.tick(20.0), None, "time alone recovers nothing");
    g.on_measured(pose(0.41));
    assert_eq!(g.on_recovery(), Ok(Some(Order::Hold(pose(0.41)))));
    assert_eq!((g.mode(), g.target()), (Mode::Idle, Some(pose(0.41))), "it must be enabled again");
}

#[test]
fn hold_and_recovery_send_no_unnecessary_order() {
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    assert_eq!((g.on_hold(), g.on_recovery()), (Ok(None), Ok(None)), "an idle arm is nobody's");
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    assert_eq!(g.on_recovery(), Ok(None), "nothing is latched");
    assert_eq!((g.mode(), g.target()), (Mode::Tracking, Some(pose(0.45))), "it goes on");
    assert_eq!(g.on_hold(), Ok(Some(Order::Hold(pose(0.4)))));
    assert_eq!((g.mode(), g.target()), (Mode::Hold, Some(pose(0.4))));
    assert_eq!(g.clone().tick(12.1), Some(Order::End), "a held arm is watched all the same");
    g.on_move_begins(&rivals(1), false).unwrap();
    assert_eq!(g.on_recovery(), Ok(None));
    assert_eq!(g.mode(), Mode::Moving);
    g.on_measured(pose(0.42));
    assert_eq!(g.on_hold(), Ok(Some(Order::Hold(pose(0.42)))));
    assert_eq!((g.mode(), g.target()), (Mode::Hold, Some(pose(0.42))));
}

#[test]
fn an_arm_that_is_pushed_or_blocked_is_latched() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    // A deviation of 0.14 m, then one of 0.16 m: the limit is 1.5 times 0.1 m.
    g.on_measured(pose(0.31));
    assert_eq!(g.tick(10.1), None, "a lag");
    g.on_measured(pose(0.29));
    assert_eq!(g.tick(10.1), Some(Order::End));
    assert_eq!(g.mode(), Mode::Reflex);
    assert!(g.fault().contains("pushed or blocked: 0.160 m"), "{}", g.fault());
    let turned = nalgebra::UnitQuaternion::from_euler_angles(0.5, 0.0, 0.0) * pose(0.4).rotation();
    let mut g = gate();
    g.on_measured(ArmPose::from_parts(pose(0.4).position_m, &turned));
    assert_eq!((g.tick(9.1), g.mode()), (Some(Order::End), Mode::Reflex), "turned while it held");
}

#[test]
fn a_user_stop_stays_latched_after_its_release() {
    let mut g = gate();
    g.on_user_stop(true);
    assert_eq!(g.on_recovery(), Err(Refusal::StillStopped));
    g.on_user_stop(false);
    assert_eq!(g.mode(), Mode::UserStop);
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::Latched("user stop")));
    assert!(g.on_recovery().is_ok());
}

#[test]
fn a_replay_does_not_reach_a_real_arm_unless_allowed() {
    let enable = |real, allow_replay| {
        let mut g = SafetyGate::new(GateSettings { allow_replay, ..GateSettings::default() }, real);
        g.on_measured(pose(0.4));
        g.on_enable(&rivals(1), true).map(|_| ())
    };
    assert_eq!(enable(true, false), Err(Refusal::Replay));
    assert_eq!(enable(true, true), Ok(()));
    assert_eq!(enable(false, false), Ok(()), "a simulated arm may follow");
}

#[test]
fn an_enabled_arm_accepts_no_target_when_time_comes_from_a_replay() {
    let replayed = Command { simulated_time: true, ..command(0.42) };
    assert_eq!(rejected(&mut gate(), &replayed), Rejection::Replay);
    let mut g = SafetyGate::new(GateSettings::default(), false);
    g.on_measured(pose(0.4));
    g.on_enable(&rivals(1), true).unwrap();
    assert!(matches!(g.on_command(&replayed, 10.0), Verdict::Accepted { .. }), "a simulated arm may follow");
}

#[test]
fn a_move_to_the_start_rejects_targets_and_an_enabled_arm_holds_after_it() {
    let mut g = gate();
    g.on_move_begins(&rivals(1), false).unwrap();
    assert!(matches!(g.on_command(&command(0.4), 10.0), Verdict::Rejected(Rejection::NotEnabled(_))));
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::Moving));
    g.on_measured(pose(0.42));
    g.on_move_ended(None);
    assert_eq!((g.mode(), g.target()), (Mode::Hold, Some(pose(0.42))));
}

#[test]
fn a_move_to_the_start_enables_no_arm() {
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    for target in [Some(pose(0.4)), None] {
        g.on_move_begins(&rivals(1), false).unwrap();
        g.on_move_begins(&rivals(1), false).unwrap();
        g.on_move_ended(target);
        assert_eq!((g.mode(), g.target()), (Mode::Idle, Some(pose(0.4))));
        assert!(matches!(g.on_command(&command(0.4), 10.0), Verdict::Rejected(Rejection::NotEnabled(_))));
    }
}

#[test]
fn a_lost_arm_refuses_everything_and_comes_back_idle() {
    let mut g = gate();
    g.on_connection(false);
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::Disconnected));
    assert_eq!(g.on_recovery(), Err(Refusal::Disconnected));
    g.on_connection(true);
    assert_eq!(g.mode(), Mode::Idle);
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::NoPose), "the old pose counts no more");
}

#[test]
fn latched_stops_outlive_the_connection() {
    let mut g = gate();
    g.on_reflex("contact");
    g.on_connection(false);
    assert_eq!((g.mode(), g.fault()), (Mode::Disconnected, "no connection to the arm"));
    g.on_connection(true);
    g.on_measured(pose(0.4));
    assert_eq!((g.mode(), g.fault()), (Mode::Reflex, "contact"));
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::Latched("reflex")));
    g.on_recovery().unwrap();
    g.on_connection(false);
    g.on_user_stop(true);
    assert_eq!(g.mode(), Mode::Disconnected, "a stop brings no arm back");
    g.on_connection(true);
    g.on_measured(pose(0.4));
    assert_eq!(g.on_enable(&rivals(1), false), Err(Refusal::Latched("user stop")));
    assert_eq!(g.on_recovery(), Err(Refusal::StillStopped));
    g.on_user_stop(false);
    g.on_recovery().unwrap();
    assert!(g.on_enable(&rivals(1), false).is_ok());
}

#[test]
fn an_arm_that_hears_nothing_outside_an_episode_is_disabled() {
    let mut g = gate();
    g.on_episode_ended();
    assert_eq!(g.tick(100.0), None);
    g.on_command(&command(0.45), 130.0);
    assert_eq!(g.tick(189.0), None, "59 s after the last target");
    assert_eq!(g.tick(190.5), Some(Order::End));
    assert_eq!(g.mode(), Mode::Idle);
    assert!(g.fault().contains("outside an episode"), "{}", g.fault());
    g.on_enable(&rivals(1), false).unwrap();
    assert_eq!(g.tick(200.0), None, "a new request begins anew");
}

#[test]
fn an_arm_that_is_enabled_after_its_runner_died_is_disabled_again() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    g.tick(10.5);
    assert_eq!(g.tick(13.0), Some(Order::End), "the runner died in the episode, without a word");
    g.on_enable(&rivals(0), false).unwrap();
    assert_eq!(g.tick(20.0), None);
    assert_eq!(g.tick(81.0), Some(Order::End));
}

#[test]
fn a_hold_ends_the_episode() {
    let mut g = gate();
    g.on_command(&command(0.45), 10.0);
    assert_eq!(g.on_hold().unwrap(), Some(Order::Hold(pose(0.4))));
    let Verdict::Rejected(why) = g.on_command(&command(0.45), 10.1) else { panic!("the policy went on") };
    assert_eq!(why, Rejection::EpisodeOver("held by a request".to_owned()));
    g.on_episode_ended();
    g.on_enable(&rivals(1), false).unwrap();
    assert!(matches!(g.on_command(&command(0.45), 11.0), Verdict::Accepted { .. }), "enabling begins anew");
}

#[test]
fn not_one_target_of_a_stranger_is_accepted_and_the_first_ends_the_motion() {
    for wrong in [of_stranger(0.41), of_stranger(f64::NAN), of_stranger(0.9)] {
        let mut g = gate();
        g.on_command(&command(0.45), 10.0);
        let verdict = g.on_command(&wrong, 10.01);
        let stranger = Stranger { heard: Heard::Target, writer: STRANGER, bound: RUNNER };
        assert_eq!(verdict, Verdict::Rejected(Rejection::Stranger(stranger)), "also one that is wrong besides");
        assert_eq!((g.mode(), g.target(), g.counts()), (Mode::Idle, Some(pose(0.45)), (1, 1)));
        for digits in ["0101", "0202"] {
            assert!(g.fault().contains(digits), "both are named: {}", g.fault());
        }
        let next = g.on_command(&command(0.45), 10.02);
        assert!(matches!(next, Verdict::Rejected(Rejection::NotEnabled(_))), "the motion has ended for both");
    }
}

#[test]
fn a_stranger_is_heard_while_the_arm_holds_and_while_it_moves_to_its_start() {
    let mut g = gate();
    g.on_hold().unwrap();
    assert!(matches!(g.on_command(&of_stranger(0.4), 10.0), Verdict::Rejected(Rejection::Stranger(_))));
    assert_eq!(g.mode(), Mode::Idle);
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    g.on_move_begins(&rivals(1), false).unwrap();
    assert!(matches!(g.on_command(&command(0.4), 10.0), Verdict::Rejected(Rejection::NotEnabled(_))));
    assert_eq!(g.mode(), Mode::Moving, "its own publisher is refused, and the move goes on");
    assert!(matches!(g.on_command(&of_stranger(0.4), 10.0), Verdict::Rejected(Rejection::Stranger(_))));
    assert_eq!(g.mode(), Mode::Idle);
}

#[test]
fn an_arm_that_was_enabled_before_anybody_published_follows_the_first_acceptable_writer_alone() {
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    g.on_enable(&rivals(0), false).unwrap();
    assert!(g.awaits_writer());
    assert!(matches!(g.on_command(&of_stranger(f64::NAN), 10.0), Verdict::Rejected(Rejection::NotFinite)));
    assert!(g.awaits_writer(), "a wrong target binds nothing");
    assert!(matches!(g.on_command(&command(0.41), 10.0), Verdict::Accepted { .. }));
    assert_eq!(g.writer(), Some(RUNNER));
    assert!(matches!(g.on_command(&of_stranger(0.41), 10.0), Verdict::Rejected(Rejection::Stranger(_))));
}

#[test]
fn a_publisher_that_was_started_again_is_a_stranger_until_the_arm_is_enabled_again() {
    let again = Command { writer: [3; 16], ..command(0.41) };
    let mut g = gate();
    g.on_command(&command(0.41), 10.0);
    assert!(matches!(g.on_command(&again, 10.1), Verdict::Rejected(Rejection::Stranger(_))));
    g.on_enable(&Rivals { writer: Some([3; 16]), ..rivals(1) }, false).unwrap();
    assert!(matches!(g.on_command(&again, 10.2), Verdict::Accepted { .. }));
    // A request to an arm that is enabled binds it anew, too.
    g.on_enable(&rivals(1), false).unwrap();
    assert!(matches!(g.on_command(&command(0.41), 10.3), Verdict::Accepted { .. }));
}

#[test]
fn an_event_of_another_writer_within_an_episode_ends_the_motion() {
    for starts in [true, false] {
        let mut g = gate();
        g.admit_event(RUNNER, true).unwrap();
        g.on_command(&command(0.41), 10.0);
        let stranger = g.admit_event(STRANGER, starts).unwrap_err();
        assert_eq!(stranger, Stranger { heard: Heard::EpisodeEvent, writer: STRANGER, bound: RUNNER });
        assert_eq!((g.on_stranger(&stranger), g.mode()), (Some(Order::End), Mode::Idle));
        assert!(g.fault().contains("an episode event came from"), "{}", g.fault());
        assert!(g.admit_event(RUNNER, false).is_ok(), "its own runner may end it");
    }
}

#[test]
fn an_idle_arm_takes_the_begin_of_any_episode_and_nobodys_end_of_another() {
    let mut g = gate();
    g.admit_event(RUNNER, true).unwrap();
    g.on_disable();
    assert!(g.admit_event(STRANGER, false).is_err());
    assert_eq!(g.on_stranger(&g.clone().admit_event(STRANGER, false).unwrap_err()), None, "nothing moves");
    // The runner has died, and was started again: it enables the arm, and announces its episode.
    g.on_enable(&rivals(1), false).unwrap();
    assert!(g.admit_event(STRANGER, false).is_err());
    assert!(g.admit_event([3; 16], true).is_ok());
    assert!(g.admit_event(RUNNER, true).is_err());
    // An episode that was announced before the arm was enabled is nobody else's once its targets come.
    let mut g = SafetyGate::new(GateSettings::default(), true);
    g.on_measured(pose(0.4));
    g.admit_event(RUNNER, true).unwrap();
    g.on_enable(&rivals(1), false).unwrap();
    g.on_command(&command(0.41), 10.0);
    assert!(g.admit_event(STRANGER, true).is_err());
}

#[test]
fn names_replace_the_identifiers_of_the_fault_that_they_belong_to_alone() {
    let mut g = gate();
    let Verdict::Rejected(Rejection::Stranger(stranger)) = g.on_command(&of_stranger(0.4), 10.0) else {
        panic!("accepted")
    };
    g.name_stranger(&stranger, "/lab came");
    assert_eq!(g.fault(), "/lab came");
    g.on_enable(&rivals(1), false).unwrap();
    g.name_stranger(&stranger, "late");
    assert_eq!(g.fault(), "", "the arm was enabled again meanwhile");
}
