//! Checks 4, 5, 6 and 16: motions and their limits.

use crate::rig::{NO_FILTER, Rig, assert_reflex, recover, row};
use franka::{
    CartesianPose, CartesianVelocities, ControllerMode, FrankaError, JointPositions, JointVelocities, Robot, Torques,
    motion_finished,
};
use panda_emulator::fci::MoveStatus;
use panda_emulator::server::Event;
use std::time::Instant;

const IMPEDANCE: ControllerMode = ControllerMode::JointImpedance;

#[test]
fn check_04_a_torque_loop_loses_nothing() {
    let rig = Rig::new();
    let robot = rig.robot();
    let (mut cycles, mut rate) = (0, 0.0);
    let began = Instant::now();
    let torques = |state: &franka::RobotState, _| {
        cycles += 1;
        rate = state.control_command_success_rate;
        let torques = Torques::new([0.0; 7]);
        if cycles == 1000 { motion_finished(torques) } else { torques }
    };
    robot.control_torques(torques, false, NO_FILTER).unwrap();
    let ratio = 1.0 / began.elapsed().as_secs_f64();
    assert!(rate > 0.999, "success rate {rate}");
    assert_eq!(rig.ends(), [MoveStatus::Success]);
    row(4, &format!("1000 cycles, success rate {rate:.3}, {ratio:.0} times real time"));
}

/// Smooth profile from 0 to 1 within the cycles: its first two derivatives vanish at both ends.
fn smooth(cycle: u32, cycles: u32) -> f64 {
    let s = f64::from(cycle) / f64::from(cycles);
    s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s)
}

#[test]
fn check_05_limited_motions_never_trip() {
    const CYCLES: u32 = 2000;
    let rig = Rig::new();
    let robot = rig.robot();
    let start = robot.read_once().unwrap();
    let mut n = 0;
    let mut next = || {
        n += 1;
        (n, n == CYCLES)
    };
    let move_to = |(n, done), to: &dyn Fn(f64) -> [f64; 7]| {
        let command = JointPositions::new(to(smooth(n, CYCLES)));
        if done { motion_finished(command) } else { command }
    };
    let to = |s: f64| std::array::from_fn(|i| start.q_d[i] + if i == 3 { 0.3 * s } else { 0.0 });
    robot.control_joint_positions(|_, _| move_to(next(), &to), IMPEDANCE, true, NO_FILTER).unwrap();
    n = 0;
    robot
        .control_joint_velocities(
            |_, _| {
                n += 1;
                let mut dq = [0.0; 7];
                dq[0] = 0.2 * (std::f64::consts::TAU * f64::from(n) / f64::from(CYCLES)).sin();
                let command = JointVelocities::new(dq);
                if n == CYCLES { motion_finished(command) } else { command }
            },
            IMPEDANCE,
            true,
            NO_FILTER,
        )
        .unwrap();
    let pose = robot.read_once().unwrap().O_T_EE_c;
    n = 0;
    robot
        .control_cartesian_pose(
            |_, _| {
                n += 1;
                let mut to = pose;
                to[14] += 0.05 * smooth(n, CYCLES);
                let command = CartesianPose::new(to);
                if n == CYCLES { motion_finished(command) } else { command }
            },
            ControllerMode::CartesianImpedance,
            true,
            NO_FILTER,
        )
        .unwrap();
    n = 0;
    robot
        .control_cartesian_velocities(
            |_, _| {
                n += 1;
                let speed = 0.05 * (std::f64::consts::TAU * f64::from(n) / f64::from(CYCLES)).sin();
                let command = CartesianVelocities::new([0.0, speed, 0.0, 0.0, 0.0, 0.0]);
                if n == CYCLES { motion_finished(command) } else { command }
            },
            ControllerMode::CartesianImpedance,
            true,
            NO_FILTER,
        )
        .unwrap();
    assert_eq!(rig.ends(), [MoveStatus::Success; 4]);
    row(5, "joint positions, joint velocities, poses and twists with rate limits: no reflex");
}

/// Speeds that grow by so much each cycle.
fn joint_speeds(robot: &Robot, change_rad_s: f64) -> franka::FrankaResult<()> {
    let mut speed = 0.0;
    robot.control_joint_velocities(
        |_, _| {
            speed += change_rad_s;
            JointVelocities::new([speed, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        },
        IMPEDANCE,
        false,
        NO_FILTER,
    )
}

fn joint_positions(robot: &Robot, first_rad: f64, then_rad: f64) -> franka::FrankaResult<()> {
    let start = robot.read_once()?.q_d;
    let mut n = 0;
    robot.control_joint_positions(
        |_, _| {
            n += 1;
            let mut q = start;
            q[0] += if n < 10 { first_rad } else { then_rad };
            JointPositions::new(q)
        },
        IMPEDANCE,
        false,
        NO_FILTER,
    )
}

fn poses(robot: &Robot, first_m: f64, then_m: f64) -> franka::FrankaResult<()> {
    let start = robot.read_once()?.O_T_EE_c;
    let mut n = 0;
    robot.control_cartesian_pose(
        |_, _| {
            n += 1;
            let mut pose = start;
            pose[12] += if n < 10 { first_m } else { then_m };
            CartesianPose::new(pose)
        },
        IMPEDANCE,
        false,
        NO_FILTER,
    )
}

fn twists(robot: &Robot, change_m_s: f64) -> franka::FrankaResult<()> {
    let mut speed = 0.0;
    robot.control_cartesian_velocities(
        |_, _| {
            speed += change_m_s;
            CartesianVelocities::new([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
        },
        IMPEDANCE,
        false,
        NO_FILTER,
    )
}

#[test]
fn check_05_each_exceeded_limit_names_its_error() {
    let rig = Rig::new();
    let robot = rig.robot();
    // Limits: 2.175 rad/s, 15 rad/s2 and 7500 rad/s3 at joint 1; 1.7 m/s, 13 m/s2.
    type Motion = fn(&Robot) -> franka::FrankaResult<()>;
    let motions: [(&str, Motion); 7] = [
        ("joint_motion_generator_velocity_limits_violation", |r| joint_speeds(r, 0.007)),
        ("joint_motion_generator_acceleration_discontinuity", |r| joint_speeds(r, 0.016)),
        ("joint_position_motion_generator_start_pose_invalid", |r| joint_positions(r, 0.1, 0.1)),
        ("joint_motion_generator_velocity_discontinuity", |r| joint_positions(r, 0.0, 0.001)),
        ("cartesian_position_motion_generator_start_pose_invalid", |r| poses(r, 0.05, 0.05)),
        ("cartesian_motion_generator_velocity_discontinuity", |r| poses(r, 0.0, 0.001)),
        ("cartesian_motion_generator_acceleration_discontinuity", |r| twists(r, 0.05)),
    ];
    for (error, motion) in motions {
        assert_reflex(&robot, motion(&robot), error);
        let refused = joint_speeds(&robot, 0.001);
        assert!(matches!(refused, Err(FrankaError::Command(_))), "{error}: a motion in mode Reflex: {refused:?}");
        recover(&robot);
    }
    row(5, "seven limits exceeded, each with its error; Move refused until recovery");
}

/// Torques that grow to `steps` times the change and end.
fn torques(robot: &Robot, change_n_m: f64) -> franka::FrankaResult<()> {
    let mut n = 0;
    robot.control_torques(
        |_, _| {
            n += 1;
            // Up and down within four cycles, so that the arm stays where it is.
            let torque = if n % 4 < 2 { change_n_m } else { 0.0 };
            let command = Torques::new([if n % 2 == 0 { 0.0 } else { torque }, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
            if n == 21 { motion_finished(Torques::new([0.0; 7])) } else { command }
        },
        false,
        NO_FILTER,
    )
}

#[test]
fn check_06_torque_rate() {
    let rig = Rig::new();
    let robot = rig.robot();
    torques(&robot, 1.0).unwrap();
    assert_reflex(&robot, torques(&robot, 1.01), "controller_torque_discontinuity");
    recover(&robot);
    row(6, "1 N m per cycle passes, 1.01 N m gives controller_torque_discontinuity");
}

#[test]
fn check_16_every_motion_has_one_end() {
    let rig = Rig::new();
    let robot = rig.robot();
    for _ in 0..20 {
        torques(&robot, 0.5).unwrap();
    }
    let started = rig.events().iter().filter(|e| **e == Event::MotionStarted).count();
    assert_eq!((started, rig.ends()), (20, vec![MoveStatus::Success; 20]));
    row(16, "20 motions, 20 ends");
}
