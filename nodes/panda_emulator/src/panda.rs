//! Stand-in of the core: an arm that rests, for the tests of the server until the core is there.

use crate::fci::{
    Answer, Generation, MoveStatus, Request, RobotCommand, RobotMode, RobotState, SetterStatus, StopStatus,
};

/// Settings.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Generation of the robot.
    pub generation: Generation,
}

/// Invalid setting.
#[derive(Debug, thiserror::Error)]
#[error("invalid setting")]
pub struct SettingsError;

/// Resting arm.
#[derive(Debug)]
pub struct Panda {
    settings: Settings,
    state: RobotState,
    answers: Vec<(u32, Answer)>,
    running: Option<u32>,
}

#[expect(missing_docs, reason = "stand-in")]
impl Panda {
    pub fn new(settings: Settings, _seed: u64) -> Result<Self, SettingsError> {
        let q = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785];
        let state = RobotState {
            robot_mode: RobotMode::Idle,
            q,
            q_d: q,
            o_ddp_o: [0.0, 0.0, -9.81],
            elbow: [0.0, -1.0],
            ..RobotState::default()
        };
        Ok(Self { settings, state, answers: Vec::new(), running: None })
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    pub fn request(&mut self, id: u32, request: &Request) {
        let answer = match request {
            Request::Move(wanted) => {
                self.running = Some(id);
                self.state.motion = Some((wanted.generator, wanted.controller));
                self.state.robot_mode = RobotMode::Move;
                Answer::Move(MoveStatus::MotionStarted)
            }
            Request::StopMove => {
                self.end(MoveStatus::Preempted);
                Answer::Stop(StopStatus::Success)
            }
            Request::AutomaticErrorRecovery => Answer::Recovery(crate::fci::RecoveryStatus::Success),
            Request::GetCartesianLimit(_) => {
                Answer::CartesianLimit(SetterStatus::Success, [0.0; 3], crate::fci::IDENTITY, false)
            }
            other => {
                match other {
                    Request::SetLoad(load) => self.state.m_load = load.mass_kg,
                    Request::SetEeToK(frame) => self.state.ee_t_k = *frame,
                    Request::SetNeToEe(frame) => (self.state.ne_t_ee, self.state.f_t_ee) = (*frame, *frame),
                    _ => {}
                }
                Answer::Setter(other.clone(), SetterStatus::Success)
            }
        };
        self.answers.push((id, answer));
    }

    fn end(&mut self, status: MoveStatus) {
        if let Some(id) = self.running.take() {
            self.state.motion = None;
            self.state.robot_mode = RobotMode::Idle;
            self.state.control_command_success_rate = 0.0;
            self.answers.push((id, Answer::Move(status)));
        }
    }

    pub fn cycle(&mut self, command: Option<&RobotCommand>) -> &RobotState {
        self.state.message_id += 1;
        if let Some(command) = command {
            self.state.tau_j_d = command.tau_j_d;
            self.state.control_command_success_rate = 1.0;
            if command.finished {
                self.end(MoveStatus::Success);
            }
        }
        &self.state
    }

    pub fn state(&self) -> &RobotState {
        &self.state
    }

    pub fn take_answers(&mut self) -> Vec<(u32, Answer)> {
        std::mem::take(&mut self.answers)
    }

    pub fn client_left(&mut self) {
        self.end(MoveStatus::Aborted);
        self.answers.clear();
    }

    pub fn set_user_stop(&mut self, pressed: bool) {
        if pressed {
            self.end(MoveStatus::EmergencyAborted);
        }
        self.state.robot_mode = if pressed { RobotMode::UserStopped } else { RobotMode::Idle };
    }

    pub fn set_brakes(&mut self, open: bool) {
        self.state.robot_mode = if open { RobotMode::Idle } else { RobotMode::Other };
    }

    pub fn set_guiding(&mut self, pressed: bool) {
        self.state.robot_mode = if pressed { RobotMode::Guiding } else { RobotMode::Idle };
    }

    pub fn push(&mut self, _wrench: [f64; 6]) {}

    pub fn true_hand(&self) -> ([f64; 16], [f64; 6]) {
        (self.state.o_t_ee, [0.0; 6])
    }

    pub fn true_joints(&self) -> (&[f64; 7], &[f64; 7]) {
        (&self.state.q, &self.state.dq)
    }
}
