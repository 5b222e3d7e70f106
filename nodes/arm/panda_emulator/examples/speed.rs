//! Prints the computing time of a cycle: torque control of an arm that moves, and the internal controllers.
#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "an example measures time and prints it")]

use panda_emulator::fci::{ControllerMode, Generator, IDENTITY, MoveRequest, Request, RobotCommand};
use panda_emulator::{Panda, Settings};
use std::time::Instant;

const CYCLES: u32 = 20_000;

fn main() -> Result<(), panda_emulator::SettingsError> {
    for (name, controller, generator) in [
        ("torque control", ControllerMode::External, Generator::JointVelocity),
        ("joint positions, joint impedance", ControllerMode::JointImpedance, Generator::JointPosition),
        ("poses, Cartesian impedance", ControllerMode::CartesianImpedance, Generator::CartesianPosition),
    ] {
        let mut panda = Panda::new(Settings::default(), 1)?;
        let deviation = [10.0, 3.12, 6.3];
        let request = MoveRequest { controller, generator, path_deviation: deviation, goal_deviation: deviation };
        panda.request(1, &Request::Move(request));
        let start = panda.state().clone();
        let mut command = RobotCommand {
            message_id: 0,
            q_c: start.q_d,
            dq_c: [0.0; 7],
            o_t_ee_c: IDENTITY,
            o_dp_ee_c: [0.0; 6],
            elbow_c: None,
            tau_j_d: [0.0; 7],
            finished: false,
        };
        let began = Instant::now();
        for k in 0..CYCLES {
            let wave = 1.0 - (f64::from(k) * 1e-3).cos();
            command.message_id = panda.state().message_id;
            command.q_c[0] = start.q_d[0] + 0.1 * wave;
            command.tau_j_d[6] = 0.2 * (f64::from(k) * 5e-3).sin();
            command.o_t_ee_c = start.o_t_ee_c;
            command.o_t_ee_c[13] += 0.05 * wave;
            panda.cycle(Some(&command));
        }
        let per_cycle_us = began.elapsed().as_secs_f64() * 1e6 / f64::from(CYCLES);
        println!("{name}: {per_cycle_us:.1} us per cycle, ended in mode {:?}", panda.state().robot_mode);
    }
    Ok(())
}
