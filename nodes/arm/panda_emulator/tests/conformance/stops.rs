//! Checks 9, 10 and 11: stops.

use crate::rig::{NO_FILTER, Rig, assert_reflex, recover, row, wait_for_mode};
use franka::{ControllerMode, FrankaError, JointVelocities, MoveStatus, RobotMode, Torques, motion_finished};
use panda_emulator::fci::MoveStatus as End;
use std::sync::atomic::{AtomicU32, Ordering};

/// Motion that another thread ends. Counts its commands.
fn endless(robot: &franka::Robot, commands: &AtomicU32) -> franka::FrankaResult<()> {
    let torques = |_: &franka::RobotState, _| {
        commands.fetch_add(1, Ordering::Relaxed);
        Torques::new([0.0; 7])
    };
    robot.control_torques(torques, false, NO_FILTER)
}

/// Waits until the client commands. One that has not read a state of its motion yet takes a stop for a motion that never began.
fn wait_for_commands(rig: &Rig, commands: &AtomicU32) {
    rig.wait_for("the first commands", |_| commands.load(Ordering::Relaxed) > 1);
}

/// Status with which a motion ended that is no success.
fn status(result: franka::FrankaResult<()>) -> Option<MoveStatus> {
    match result {
        Err(FrankaError::Control(exception)) => exception.move_status,
        other => panic!("expected a control exception, got {other:?}"),
    }
}

#[test]
fn check_09_stop_from_another_thread() {
    let rig = Rig::new();
    let robot = rig.robot();
    let commands = AtomicU32::new(0);
    let motion = std::thread::scope(|scope| {
        let motion = scope.spawn(|| endless(&robot, &commands));
        wait_for_commands(&rig, &commands);
        robot.stop().unwrap();
        motion.join().unwrap()
    });
    assert_eq!(status(motion), Some(MoveStatus::Preempted));
    wait_for_mode(&robot, RobotMode::Idle);
    robot.stop().unwrap();
    robot.stop().unwrap();
    assert_eq!(rig.ends(), [End::Preempted]);
    row(9, "stop in a motion: Preempted; stop without a motion twice: accepted");
}

#[test]
fn check_10_user_stop() {
    let rig = Rig::new();
    let robot = rig.robot();
    let commands = AtomicU32::new(0);
    let motion = std::thread::scope(|scope| {
        let motion = scope.spawn(|| endless(&robot, &commands));
        wait_for_commands(&rig, &commands);
        rig.handle.set_user_stop(true);
        motion.join().unwrap()
    });
    assert_eq!(status(motion), Some(MoveStatus::EmergencyAborted));
    let state = wait_for_mode(&robot, RobotMode::UserStopped);
    assert!(!state.current_errors.any(), "no error while stopped");
    assert!(matches!(endless(&robot, &commands), Err(FrankaError::Command(_))), "a motion while stopped is refused");
    rig.handle.set_user_stop(false);
    wait_for_mode(&robot, RobotMode::Idle);
    recover(&robot);
    rig.handle.set_user_stop(true);
    wait_for_mode(&robot, RobotMode::UserStopped);
    rig.handle.set_user_stop(false);
    wait_for_mode(&robot, RobotMode::Idle);
    recover(&robot);
    let mut n = 0;
    let torques = |_: &franka::RobotState, _| {
        n += 1;
        let torques = Torques::new([0.0; 7]);
        if n == 50 { motion_finished(torques) } else { torques }
    };
    robot.control_torques(torques, false, NO_FILTER).unwrap();
    row(10, "EmergencyAborted in a motion; motions again after release and recovery");
}

#[test]
fn check_11_end_while_moving() {
    let rig = Rig::new();
    let robot = rig.robot();
    let mut n = 0;
    // 5 N m at joint 1, reached in steps of 0.05 N m, turns the arm above 0.03 rad/s within 0.3 s.
    let torques = |_: &franka::RobotState, _| {
        n += 1;
        let torques = Torques::new([(0.05 * f64::from(n)).min(5.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        if n == 300 { motion_finished(torques) } else { torques }
    };
    let moving = robot.control_torques(torques, false, NO_FILTER);
    assert_reflex(&robot, moving, "joint_motion_generator_velocity_discontinuity");
    recover(&robot);
    let mut n = 0;
    let stop = |_: &franka::RobotState, _| {
        n += 1;
        let command = JointVelocities::new([0.0; 7]);
        if n == 50 { motion_finished(command) } else { command }
    };
    robot.control_joint_velocities(stop, ControllerMode::JointImpedance, true, NO_FILTER).unwrap();
    row(11, "finished at speed: joint_motion_generator_velocity_discontinuity");
}
