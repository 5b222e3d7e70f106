//! Checks 8, 12 and 13: lost commands and states, and a client that falls silent.

use crate::rig::{NO_FILTER, Rig, assert_reflex, recover, row};
use franka::{RobotMode, Torques, motion_finished};
use panda_emulator::fci::{MoveStatus, RobotMode as Mode};
use panda_emulator::server::{Event, Fault, Network, ServerOptions};

/// Motion of so many cycles with torques of zero. At cycle 150, `fault` happens. Returns the least success rate.
fn torques(robot: &franka::Robot, cycles: u32, mut fault: impl FnMut()) -> franka::FrankaResult<f64> {
    let (mut n, mut least) = (0, 1.0_f64);
    let mut last = None;
    robot.control_torques(
        |state, _| {
            n += 1;
            assert!(last.is_none_or(|last| state.time > last), "the client went back in time");
            last = Some(state.time);
            if n == 150 {
                fault();
            }
            if n > 150 {
                least = least.min(state.control_command_success_rate);
            }
            let command = Torques::new([0.0; 7]);
            if n >= cycles { motion_finished(command) } else { command }
        },
        false,
        NO_FILTER,
    )?;
    Ok(least)
}

#[test]
fn check_08_nineteen_lost_commands_pass_and_twenty_abort() {
    let rig = Rig::new();
    let robot = rig.robot();
    let rate = torques(&robot, 400, || rig.handle.inject(Fault::LoseCommands(19))).unwrap();
    assert!((rate - 0.81).abs() < 0.015, "success rate {rate}");
    let lost = torques(&robot, 400, || rig.handle.inject(Fault::LoseCommands(20))).map(|_| ());
    assert_reflex(&robot, lost, "communication_constraints_violation");
    recover(&robot);
    torques(&robot, 200, || {}).unwrap();
    row(8, &format!("19 lost: success rate {rate:.2}; 20 lost: communication_constraints_violation"));
}

#[test]
fn check_12_lost_repeated_and_swapped_states() {
    let rig = Rig::new();
    let robot = rig.robot();
    for fault in [Fault::LoseStates(5), Fault::RepeatStates(5), Fault::SwapStates] {
        let rate = torques(&robot, 400, || rig.handle.inject(fault)).unwrap();
        assert!(rate >= 0.93, "{fault:?}: success rate {rate}");
    }
    assert_eq!(rig.ends(), [MoveStatus::Success; 3]);
    row(12, "motions go on after lost, repeated and swapped states");
}

#[test]
fn check_12_a_laboratory_s_network() {
    let rig = Rig::with(ServerOptions { network: Network::Lab, seed: 3, ..ServerOptions::default() });
    let rate = torques(&rig.robot(), 5000, || {}).unwrap();
    assert!((0.80..1.0).contains(&rate), "least success rate {rate}");
    row(12, &format!("preset lab, 5000 cycles: least success rate {rate:.2}"));
}

#[test]
fn check_13_a_client_that_falls_silent_in_a_motion() {
    let rig = Rig::new();
    let robot = rig.robot();
    let mut control = robot.start_torque_control().unwrap();
    for _ in 0..50 {
        control.read_once().unwrap();
        control.write_once(&Torques::new([0.0; 7])).unwrap();
    }
    rig.wait_for("the reflex", |events| events.contains(&Event::Mode(Mode::Reflex)));
    assert_eq!(rig.ends(), [MoveStatus::ReflexAborted]);
    drop(control);
    drop(robot);
    rig.wait_for("the end", |events| events.contains(&Event::ClientLeft));
    let robot = rig.robot();
    assert_eq!(robot.read_once().unwrap().robot_mode, RobotMode::Reflex);
    recover(&robot);
    row(13, "silent in a motion: reflex, then the next client recovers");
}
