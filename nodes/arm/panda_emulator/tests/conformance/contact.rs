//! Checks 7 and 15: contact, and a load that the control box does not know.

use crate::rig::{NO_FILTER, Rig, assert_reflex, recover, row};
use franka::{CartesianPose, ControllerMode, Robot, RobotState, motion_finished};
use std::cell::RefCell;

/// Holds the pose for so many cycles. Returns the last state, and whether a contact was reported before.
fn hold(robot: &Robot, cycles: u32, mut at: impl FnMut(u32)) -> (franka::FrankaResult<()>, RobotState, bool) {
    let pose = robot.read_once().unwrap().O_T_EE_c;
    let last = RefCell::new((RobotState::default(), false));
    let mut n = 0;
    let result = robot.control_cartesian_pose(
        |state, _| {
            n += 1;
            at(n);
            let (last_state, contact) = &mut *last.borrow_mut();
            *contact |= state.cartesian_contact.iter().any(|c| *c > 0.0);
            *last_state = *state;
            let command = CartesianPose::new(pose);
            if n == cycles { motion_finished(command) } else { command }
        },
        ControllerMode::CartesianImpedance,
        false,
        NO_FILTER,
    );
    let (state, contact) = last.into_inner();
    (result, state, contact)
}

#[test]
fn check_07_contact_and_collision() {
    let rig = Rig::new();
    let robot = rig.robot();
    let push =
        |newtons: f64| move |handle: &panda_emulator::server::Handle| handle.push([newtons, 0.0, 0.0, 0.0, 0.0, 0.0]);
    robot.set_collision_behavior_simple([100.0; 7], [100.0; 7], [10.0; 6], [20.0; 6]).unwrap();
    let at = |n| {
        if n == 100 {
            push(25.0)(&rig.handle)
        }
    };
    let (result, _, contact) = hold(&robot, 3000, at);
    assert!(contact, "a contact comes before the collision");
    assert_reflex(&robot, result, "cartesian_reflex");
    push(0.0)(&rig.handle);
    recover(&robot);
    robot.set_collision_behavior_simple([100.0; 7], [100.0; 7], [100.0; 6], [100.0; 6]).unwrap();
    let at = |n| match n {
        100 => push(25.0)(&rig.handle),
        1500 => push(0.0)(&rig.handle),
        _ => {}
    };
    hold(&robot, 3000, at).0.unwrap();
    row(7, "25 N: contact, then cartesian_reflex; with thresholds of 100 N no reflex");
}

#[test]
fn check_15_an_unknown_load_lets_the_arm_sag() {
    const STIFFNESS_N_M: f64 = 500.0;
    let rig = Rig::new();
    let robot = rig.robot();
    robot.set_collision_behavior_simple([100.0; 7], [100.0; 7], [100.0; 6], [100.0; 6]).unwrap();
    robot.set_cartesian_impedance([STIFFNESS_N_M, STIFFNESS_N_M, STIFFNESS_N_M, 50.0, 50.0, 50.0]).unwrap();
    let (result, before, _) = hold(&robot, 1000, |_| {});
    result.unwrap();
    // Weight of 0.5 kg that hangs from the hand.
    let weight_n = 0.5 * 9.81;
    let at = |n| {
        if n == 1 {
            rig.handle.push([0.0, 0.0, -weight_n, 0.0, 0.0, 0.0]);
        }
    };
    let (result, after, _) = hold(&robot, 3000, at);
    result.unwrap();
    let (sag_m, expected_m) = (before.O_T_EE[14] - after.O_T_EE[14], weight_n / STIFFNESS_N_M);
    // Stiction of the joints carries a part of the weight.
    assert!((sag_m / expected_m - 1.0).abs() < 0.4, "sag {sag_m} m, expected {expected_m} m");
    row(
        15,
        &format!("0.5 kg at {STIFFNESS_N_M} N/m: {:.1} mm, weight / stiffness {:.1} mm", 1e3 * sag_m, 1e3 * expected_m),
    );
}
