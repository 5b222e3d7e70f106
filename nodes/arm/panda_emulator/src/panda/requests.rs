//! Requests of the client and acts of people at the robot.

use super::control::Hold;
use super::control::external_forces::is_singular;
use super::motion::generator::MotionGenerator;
use super::motion::{Ending, Motion};
use super::{Panda, Recovery};
use crate::fci::{
    Answer, CYCLE_S, ControllerMode, ErrorKind, Errors, Generation, Generator, IDENTITY, MoveRequest, MoveStatus,
    RecoveryStatus, Request, RobotMode, SetterStatus, StopStatus,
};

impl Panda {
    /// Takes a request of the client with its identifier. The answers wait in [`Panda::take_answers`]. A motion is answered twice, a
    /// recovery after a while. `LoadModelLibrary` and `GetRobotModel` are the server's business and get no answer.
    pub fn request(&mut self, id: u32, request: &Request) {
        let answer = match request {
            Request::Move(motion) => Some(Answer::Move(self.start_motion(id, motion))),
            Request::StopMove if !self.brakes_open => Some(Answer::Stop(StopStatus::CommandNotPossibleRejected)),
            Request::StopMove => {
                self.end_motion(Ending::Preempted);
                Some(Answer::Stop(StopStatus::Success))
            }
            Request::GetCartesianLimit(limit) => Some(self.cartesian_limit(*limit)),
            Request::AutomaticErrorRecovery => self.recover(id).map(Answer::Recovery),
            Request::LoadModelLibrary(_) | Request::GetRobotModel => None,
            setter => Some(Answer::Setter(setter.clone(), self.set(setter))),
        };
        self.answers.extend(answer.map(|a| (id, a)));
        self.report();
    }

    /// Stops the arm whose client has gone: TCP closed or silent. A running motion ends in a reflex, as on a robot (franka_ros, issue
    /// 33), so that the next client must recover; an idle arm stays idle. A recovery goes on without an answer.
    pub fn client_left(&mut self) {
        if self.motion.is_some() {
            self.end_motion(Ending::Reflex(Errors::of(ErrorKind::CommunicationConstraintsViolation)));
        }
        if let Some(recovery) = &mut self.recovery {
            recovery.id = None;
        }
        self.report();
    }

    /// Presses or releases the user stop (activation device).
    pub fn set_user_stop(&mut self, pressed: bool) {
        if pressed == self.user_stop {
            return;
        }
        self.user_stop = pressed;
        if pressed {
            self.end_motion(Ending::UserStop);
            self.hold = self.stop_here();
            self.abort_recovery(RecoveryStatus::EmergencyAborted);
        } else {
            self.guiding = false;
            self.recovery_due = self.settings.user_stop_needs_recovery;
        }
        self.report();
    }

    /// Opens or closes the brakes, as Desk does. Opening them clears a reflex.
    pub fn set_brakes(&mut self, open: bool) {
        if open == self.brakes_open {
            return;
        }
        self.brakes_open = open;
        self.end_motion(Ending::Aborted);
        self.abort_recovery(RecoveryStatus::Aborted);
        self.hold = Hold::at_rest(self.measured.readings.q);
        if open {
            self.clear_reflex();
        }
        self.report();
    }

    /// Presses or releases the buttons of the flange for guiding by hand. They act only while the user stop is pressed.
    pub fn set_guiding(&mut self, pressed: bool) {
        let guiding = pressed && self.user_stop && self.brakes_open;
        if self.guiding && !guiding {
            self.hold = self.stop_here();
        }
        self.guiding = guiding;
        self.report();
    }

    /// Mode of the control box.
    pub(super) fn mode(&self) -> RobotMode {
        if !self.brakes_open {
            RobotMode::Other
        } else if self.guiding {
            RobotMode::Guiding
        } else if self.user_stop {
            RobotMode::UserStopped
        } else if self.recovery.is_some() {
            RobotMode::AutomaticErrorRecovery
        } else if self.reflex {
            RobotMode::Reflex
        } else if self.motion.is_some() {
            RobotMode::Move
        } else {
            RobotMode::Idle
        }
    }

    fn start_motion(&mut self, id: u32, request: &MoveRequest) -> MoveStatus {
        if self.mode() != RobotMode::Idle || self.recovery_due {
            return MoveStatus::CommandNotPossibleRejected;
        }
        if !is_valid(request, self.settings.generation) {
            return MoveStatus::InvalidArgumentRejected;
        }
        let cartesian = matches!(request.generator, Generator::CartesianPosition | Generator::CartesianVelocity);
        if (cartesian || request.controller == ControllerMode::CartesianImpedance)
            && is_singular(&self.measured.jacobian)
        {
            return MoveStatus::StartAtSingularPoseRejected;
        }
        self.reflex_reason = Errors::default();
        let generator = MotionGenerator::at_rest(request.generator, self.hold.end(), &self.configuration.tool());
        self.motion = Some(Motion::new(id, *request, generator));
        MoveStatus::MotionStarted
    }

    fn set(&mut self, request: &Request) -> SetterStatus {
        let possible = match self.mode() {
            RobotMode::Idle => true,
            RobotMode::UserStopped | RobotMode::Guiding => matches!(request, Request::SetGuidingMode(..)),
            _ => false,
        };
        if !possible {
            return SetterStatus::CommandNotPossibleRejected;
        }
        let status = self.configuration.apply(request);
        self.control_body.carry(&[self.settings.end_effector.load(), self.configuration.load]);
        status
    }

    fn cartesian_limit(&self, identifier: i32) -> Answer {
        match (identifier, self.settings.workspace_box) {
            (0, Some((size, frame))) => Answer::CartesianLimit(SetterStatus::Success, size, frame, true),
            (0, None) => Answer::CartesianLimit(SetterStatus::Success, [0.0; 3], IDENTITY, false),
            _ => Answer::CartesianLimit(SetterStatus::InvalidArgumentRejected, [0.0; 3], IDENTITY, false),
        }
    }

    /// Starts a recovery. Returns the answer, if it is known at once.
    fn recover(&mut self, id: u32) -> Option<RecoveryStatus> {
        let mode = self.mode();
        if !matches!(mode, RobotMode::Idle | RobotMode::Reflex) {
            return Some(RecoveryStatus::CommandNotPossibleRejected);
        }
        if mode == RobotMode::Idle && !self.recovery_due {
            return Some(RecoveryStatus::Success);
        }
        let at_limit = self.reflex_reason.contains(ErrorKind::JointPositionLimitsViolation)
            || self.reflex_reason.contains(ErrorKind::SelfCollisionAvoidanceViolation);
        if self.reflex && at_limit && self.settings.limits_need_manual_recovery {
            return Some(RecoveryStatus::ManualErrorRecoveryRequiredRejected);
        }
        let cycles_left = ((self.settings.recovery_time_s / CYCLE_S).round() as u32).max(1);
        self.recovery = Some(Recovery { id: Some(id), cycles_left });
        None
    }

    fn abort_recovery(&mut self, status: RecoveryStatus) {
        let id = self.recovery.take().and_then(|recovery| recovery.id);
        self.answers.extend(id.map(|id| (id, Answer::Recovery(status))));
    }
}

/// Returns true if a motion can be requested in this form. Motions without a generator came with FCI 7.
fn is_valid(request: &MoveRequest, generation: Generation) -> bool {
    let known = match (request.generator, generation) {
        (Generator::None, Generation::Panda) => false,
        (Generator::None, Generation::Fr3) => request.controller == ControllerMode::External,
        _ => true,
    };
    let deviations = request.path_deviation.iter().chain(&request.goal_deviation);
    known && deviations.into_iter().all(|v| v.is_finite() && *v >= 0.0)
}
