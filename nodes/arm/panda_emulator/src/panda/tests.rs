//! Rules of the FCI at the level of the whole robot.

use super::{Panda, Settings};
use crate::fci::{
    Answer, CollisionThresholds, ControllerMode, ErrorKind, Generator, IDENTITY, MoveRequest, MoveStatus,
    RecoveryStatus, Request, RobotCommand, RobotMode, RobotState,
};

mod controllers;
mod ends;
mod generators;
mod measured;
mod requests;

const MOVE: u32 = 7;

/// Robot without noise and with a quick recovery.
fn settings() -> Settings {
    Settings { joint_speed_noise_rad_s: 0.0, recovery_time_s: 0.05, ..Settings::default() }
}

fn thresholds(torque_n_m: f64, force: f64) -> CollisionThresholds {
    CollisionThresholds {
        lower_torques_acceleration: [torque_n_m; 7],
        upper_torques_acceleration: [torque_n_m; 7],
        lower_torques_nominal: [torque_n_m; 7],
        upper_torques_nominal: [torque_n_m; 7],
        lower_forces_acceleration: [force; 6],
        upper_forces_acceleration: [force; 6],
        lower_forces_nominal: [force; 6],
        upper_forces_nominal: [force; 6],
    }
}

/// Robot and the client that commands it.
struct Session {
    panda: Panda,
    command: RobotCommand,
}

impl Session {
    fn new(settings: Settings) -> Self {
        let panda = Panda::new(settings, 1).unwrap();
        let command = RobotCommand {
            message_id: 0,
            q_c: panda.state().q_d,
            dq_c: [0.0; 7],
            o_t_ee_c: panda.state().o_t_ee_c,
            o_dp_ee_c: [0.0; 6],
            elbow_c: None,
            tau_j_d: [0.0; 7],
            finished: false,
        };
        Self { panda, command }
    }

    /// Session with a running motion that has received its first command.
    fn moving(settings: Settings, controller: ControllerMode, generator: Generator) -> Self {
        let mut session = Self::new(settings);
        assert_eq!(session.start(controller, generator), MoveStatus::MotionStarted);
        session.step();
        session
    }

    fn torque(settings: Settings) -> Self {
        Self::moving(settings, ControllerMode::External, Generator::JointVelocity)
    }

    fn start(&mut self, controller: ControllerMode, generator: Generator) -> MoveStatus {
        let deviation = [10.0, 3.12, 6.3];
        let request = MoveRequest { controller, generator, path_deviation: deviation, goal_deviation: deviation };
        self.panda.request(MOVE, &Request::Move(request));
        self.command.q_c = self.panda.state().q_d;
        self.command.o_t_ee_c = self.panda.state().o_t_ee_c;
        self.move_status().expect("an answer to Move")
    }

    /// Answers the newest state with the command.
    fn step(&mut self) -> &RobotState {
        self.command.message_id = self.panda.state().message_id;
        self.panda.cycle(Some(&self.command))
    }

    /// Answers `count` states.
    fn steps(&mut self, count: usize) {
        (0..count).for_each(|_| drop(self.step().clone()));
    }

    /// Leaves `count` states without an answer.
    fn idle(&mut self, count: usize) {
        (0..count).for_each(|_| drop(self.panda.cycle(None).clone()));
    }

    fn state(&self) -> &RobotState {
        self.panda.state()
    }

    /// The one answer to Move that waits, if there is one.
    fn move_status(&mut self) -> Option<MoveStatus> {
        let answers = self.panda.take_answers();
        let mut statuses = answers.iter().filter_map(|(id, answer)| match answer {
            Answer::Move(status) if *id == MOVE => Some(*status),
            _ => None,
        });
        let status = statuses.next();
        assert_eq!(statuses.next(), None, "a second answer to Move");
        status
    }

    fn recover(&mut self) -> RecoveryStatus {
        self.panda.request(9, &Request::AutomaticErrorRecovery);
        for _ in 0..100 {
            if let Some((_, Answer::Recovery(status))) = self.panda.take_answers().pop() {
                return status;
            }
            self.idle(1);
        }
        panic!("no answer to the recovery");
    }

    /// Asserts that the motion ended in a reflex for this one reason, and that a recovery makes the next motion possible.
    fn assert_reflex(&mut self, kind: ErrorKind) {
        let reasons: Vec<_> = self.state().reflex_reason.names().collect();
        assert_eq!(reasons, [crate::fci::ERROR_NAMES[kind as usize]]);
        assert_eq!(self.state().robot_mode, RobotMode::Reflex);
        assert_eq!((self.state().motion, self.move_status()), (None, Some(MoveStatus::ReflexAborted)));
        let refused = self.start(ControllerMode::External, Generator::JointVelocity);
        assert_eq!(refused, MoveStatus::CommandNotPossibleRejected);
        self.panda.push([0.0; 6]);
        self.idle(300);
        assert!(self.state().errors.lasting() == self.state().errors, "errors of an arm at rest");
        assert_eq!(self.recover(), RecoveryStatus::Success);
        assert_eq!(self.state().robot_mode, RobotMode::Idle);
    }
}
