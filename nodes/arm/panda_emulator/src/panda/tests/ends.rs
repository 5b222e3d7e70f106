//! Ends of motions: success, stop, loss of commands, user stop, a client that leaves.

use super::*;
use crate::Wall;

#[test]
fn torque_motion_of_1000_cycles_ends_in_success_with_rate_1() {
    let mut session = Session::torque(settings());
    session.steps(1000);
    assert_eq!(session.state().control_command_success_rate, 1.0);
    assert_eq!(session.state().motion, Some((Generator::JointVelocity, ControllerMode::External)));
    session.command.finished = true;
    session.steps(3);
    assert_eq!((session.state().motion, session.state().robot_mode), (None, RobotMode::Idle));
    assert_eq!(session.move_status(), Some(MoveStatus::Success));
}

#[test]
fn torque_may_change_by_1_n_m_in_a_cycle_and_not_by_more() {
    let mut session = Session::torque(settings());
    for sign in [1.0, -1.0] {
        session.command.tau_j_d[0] += sign;
        session.step();
        assert_eq!(session.state().tau_j_d[0], session.command.tau_j_d[0]);
    }
    session.command.tau_j_d[0] += 1.01;
    session.step();
    session.assert_reflex(ErrorKind::ControllerTorqueDiscontinuity);
}

#[test]
fn nineteen_lost_commands_are_tolerated_and_twenty_are_not() {
    let mut session = Session::torque(settings());
    session.steps(200);
    session.idle(19);
    assert_eq!((session.state().robot_mode, session.state().control_command_success_rate), (RobotMode::Move, 0.81));
    session.step();
    session.idle(19);
    assert_eq!(session.state().robot_mode, RobotMode::Move);
    session.idle(1);
    session.assert_reflex(ErrorKind::CommunicationConstraintsViolation);
}

#[test]
fn a_command_for_an_older_state_counts_as_lost() {
    let mut session = Session::torque(settings());
    for _ in 0..20 {
        session.command.message_id = session.state().message_id - 1;
        let command = session.command.clone();
        session.panda.cycle(Some(&command));
    }
    session.assert_reflex(ErrorKind::CommunicationConstraintsViolation);
}

#[test]
fn a_late_first_command_is_no_loss() {
    let mut session = Session::new(settings());
    session.start(ControllerMode::External, Generator::JointVelocity);
    session.idle(100);
    session.steps(10);
    assert_eq!((session.state().robot_mode, session.state().control_command_success_rate), (RobotMode::Move, 1.0));
}

#[test]
fn stop_preempts_the_motion_and_is_accepted_when_idle() {
    let mut session = Session::torque(settings());
    session.panda.request(8, &Request::StopMove);
    let answers = session.panda.take_answers();
    assert_eq!(answers[0], (MOVE, Answer::Move(MoveStatus::Preempted)));
    assert_eq!(answers[1], (8, Answer::Stop(crate::fci::StopStatus::Success)));
    for id in [9, 10] {
        session.panda.request(id, &Request::StopMove);
        assert_eq!(session.panda.take_answers(), [(id, Answer::Stop(crate::fci::StopStatus::Success))]);
    }
    assert_eq!(session.start(ControllerMode::External, Generator::JointVelocity), MoveStatus::MotionStarted);
}

#[test]
fn finishing_while_the_arm_moves_is_a_discontinuity() {
    let mut session = Session::torque(settings());
    for k in 0..150 {
        session.command.tau_j_d[0] = f64::from(k.min(40)) * 0.1;
        session.step();
    }
    assert!(session.state().dq[0] > 0.05, "{} rad/s", session.state().dq[0]);
    session.command.finished = true;
    session.step();
    session.assert_reflex(ErrorKind::JointMotionGeneratorVelocityDiscontinuity);
}

#[test]
fn user_stop_aborts_a_motion_and_demands_a_recovery() {
    let mut session = Session::torque(settings());
    session.panda.set_user_stop(true);
    assert_eq!(session.move_status(), Some(MoveStatus::EmergencyAborted));
    session.idle(1);
    assert_eq!((session.state().robot_mode, session.state().errors.is_empty()), (RobotMode::UserStopped, true));
    let start = |s: &mut Session| s.start(ControllerMode::External, Generator::JointVelocity);
    assert_eq!(start(&mut session), MoveStatus::CommandNotPossibleRejected);
    assert_eq!(session.recover(), RecoveryStatus::CommandNotPossibleRejected);
    session.panda.set_user_stop(false);
    assert_eq!(session.state().robot_mode, RobotMode::Idle);
    assert_eq!(start(&mut session), MoveStatus::CommandNotPossibleRejected);
    assert_eq!(session.recover(), RecoveryStatus::Success);
    assert_eq!(start(&mut session), MoveStatus::MotionStarted);
}

#[test]
fn user_stop_without_demand_for_recovery_frees_the_robot_when_released() {
    let mut session = Session::new(Settings { user_stop_needs_recovery: false, ..settings() });
    session.panda.set_user_stop(true);
    session.panda.set_user_stop(false);
    assert_eq!(session.start(ControllerMode::External, Generator::JointVelocity), MoveStatus::MotionStarted);
}

#[test]
fn user_stop_aborts_a_recovery() {
    let mut session = Session::torque(settings());
    session.idle(20);
    session.move_status();
    session.panda.request(9, &Request::AutomaticErrorRecovery);
    session.idle(1);
    assert_eq!(session.state().robot_mode, RobotMode::AutomaticErrorRecovery);
    session.panda.set_user_stop(true);
    assert_eq!(session.panda.take_answers(), [(9, Answer::Recovery(RecoveryStatus::EmergencyAborted))]);
    session.panda.set_user_stop(false);
    assert_eq!(session.state().robot_mode, RobotMode::Reflex);
}

#[test]
fn guiding_needs_the_user_stop_and_lets_a_hand_move_the_arm() {
    let mut session = Session::new(settings());
    session.panda.set_guiding(true);
    session.idle(1);
    assert_eq!(session.state().robot_mode, RobotMode::Idle);
    session.panda.set_user_stop(true);
    session.panda.set_guiding(true);
    session.panda.push([0.0, 10.0, 0.0, 0.0, 0.0, 0.0]);
    let before = session.panda.true_hand().0[13];
    session.idle(500);
    assert_eq!(session.state().robot_mode, RobotMode::Guiding);
    assert!(session.panda.true_hand().0[13] - before > 0.02);
    session.panda.push([0.0; 6]);
    session.panda.set_guiding(false);
    session.idle(300);
    assert_eq!(session.state().robot_mode, RobotMode::UserStopped);
    assert!(session.panda.true_joints().1.iter().all(|v| v.abs() < 1e-4));
}

#[test]
fn a_wall_stops_the_hand_where_it_pushes_as_hard() {
    let mut session = Session::new(settings());
    session.panda.set_user_stop(true);
    session.panda.set_guiding(true);
    let x_m = session.panda.true_hand().0[12] + 0.01;
    session.panda.set_wall(Some(Wall { x_m, stiffness_n_m: 5000.0 }));
    session.panda.push([20.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    session.idle(3000);
    // 20 N at 5000 N/m, less what friction holds.
    let beyond_m = session.panda.true_hand().0[12] - x_m;
    assert!((0.001..0.0045).contains(&beyond_m), "{beyond_m}");
    session.panda.set_wall(None);
    session.idle(500);
    assert!(session.panda.true_hand().0[12] - x_m > 0.01);
}

/// A robot whose client is killed ends up in reflex (franka_ros, issue 33).
#[test]
fn a_client_that_leaves_in_a_motion_is_a_reflex_and_the_next_one_recovers() {
    let mut session = Session::torque(settings());
    session.command.tau_j_d[0] = 1.0;
    session.steps(300);
    session.panda.client_left();
    session.idle(300);
    assert!(session.panda.true_joints().1.iter().all(|v| v.abs() < 1e-4));
    session.assert_reflex(ErrorKind::CommunicationConstraintsViolation);
    assert_eq!(session.start(ControllerMode::External, Generator::JointVelocity), MoveStatus::MotionStarted);
}

#[test]
fn a_client_that_leaves_without_a_motion_leaves_an_idle_arm() {
    let mut session = Session::new(settings());
    session.panda.client_left();
    session.idle(100);
    assert_eq!(session.state().robot_mode, RobotMode::Idle);
    assert_eq!(session.start(ControllerMode::External, Generator::JointVelocity), MoveStatus::MotionStarted);
}

#[test]
fn nan_is_an_input_error() {
    let mut session = Session::torque(settings());
    session.command.tau_j_d[3] = f64::NAN;
    session.step();
    assert_eq!(session.move_status(), Some(MoveStatus::InputErrorAborted));
}

#[test]
fn setters_are_refused_while_moving_and_after_a_reflex() {
    use crate::fci::SetterStatus;
    let setter = Request::SetJointImpedance([1000.0; 7]);
    let status = |s: &mut Session| {
        s.panda.request(3, &setter);
        match s.panda.take_answers().pop() {
            Some((3, Answer::Setter(_, status))) => status,
            other => panic!("{other:?}"),
        }
    };
    let mut session = Session::new(settings());
    assert_eq!(status(&mut session), SetterStatus::Success);
    session.start(ControllerMode::External, Generator::JointVelocity);
    session.step();
    assert_eq!(status(&mut session), SetterStatus::CommandNotPossibleRejected);
    session.idle(20);
    session.move_status();
    assert_eq!(status(&mut session), SetterStatus::CommandNotPossibleRejected);
}

#[test]
fn closed_brakes_refuse_everything_and_opening_them_clears_a_reflex() {
    let mut session = Session::torque(settings());
    session.idle(20);
    session.move_status();
    session.panda.set_brakes(false);
    session.idle(10);
    assert_eq!(session.state().robot_mode, RobotMode::Other);
    let start = |s: &mut Session| s.start(ControllerMode::External, Generator::JointVelocity);
    assert_eq!(start(&mut session), MoveStatus::CommandNotPossibleRejected);
    session.panda.set_brakes(true);
    assert_eq!(start(&mut session), MoveStatus::MotionStarted);
}

/// Every identifier of a Move gets exactly one final answer, whatever the order of requests, losses and stops.
#[test]
fn every_motion_gets_exactly_one_final_answer() {
    use std::collections::BTreeMap;
    let mut session = Session::new(settings());
    let (mut started, mut finals) = (BTreeMap::new(), BTreeMap::new());
    let mut seed = 1_u32;
    for id in 0..4000_u32 {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let deviation = [1.0; 3];
        let (controller, generator) = (ControllerMode::External, Generator::JointVelocity);
        let motion = MoveRequest { controller, generator, path_deviation: deviation, goal_deviation: deviation };
        match seed >> 28 {
            0..=4 => {
                started.insert(id, ());
                session.panda.request(id, &Request::Move(motion));
            }
            5 => session.panda.request(id, &Request::StopMove),
            6 => session.panda.request(id, &Request::AutomaticErrorRecovery),
            7 => session.panda.set_user_stop(seed & 1 << 20 == 0),
            8 => session.panda.client_left(),
            9 => session.idle(20),
            10 => {
                session.command.finished = true;
                session.step();
                session.command.finished = false;
            }
            11 => session.command.tau_j_d[0] = if session.command.tau_j_d[0] == 0.0 { 1.5 } else { 0.0 },
            _ => session.steps(5),
        }
        for (id, answer) in session.panda.take_answers() {
            match answer {
                Answer::Move(MoveStatus::MotionStarted) => {}
                Answer::Move(status) => assert_eq!(finals.insert(id, status), None, "second final answer to {id}"),
                _ => {}
            }
        }
    }
    session.panda.client_left();
    finals.extend(session.panda.take_answers().into_iter().filter_map(|(id, a)| match a {
        Answer::Move(status) => Some((id, status)),
        _ => None,
    }));
    assert_eq!(started.keys().collect::<Vec<_>>(), finals.keys().collect::<Vec<_>>());
    let kinds: std::collections::HashSet<_> = finals.values().map(|s| format!("{s:?}")).collect();
    assert!(kinds.len() >= 5, "the test met {kinds:?} only");
}

#[test]
fn motion_that_starts_while_the_arm_still_stops_begins_at_the_end_of_the_stop() {
    let mut session = Session::moving(settings(), ControllerMode::JointImpedance, Generator::JointVelocity);
    for _ in 0..500 {
        session.command.dq_c[0] += 1e-3;
        session.step();
    }
    session.panda.request(8, &Request::StopMove);
    session.idle(10);
    assert_eq!(session.move_status(), Some(MoveStatus::Preempted));
    session.command.dq_c = [0.0; 7];
    assert_eq!(session.start(ControllerMode::JointImpedance, Generator::JointVelocity), MoveStatus::MotionStarted);
    let goal_rad = session.state().q_d[0];
    session.idle(100);
    assert!((session.state().q[0] - goal_rad).abs() < 1e-3, "{} {goal_rad}", session.state().q[0]);
    session.steps(100);
    assert_eq!(session.state().robot_mode, RobotMode::Move);
}
