//! Course of a motion: it follows commands, misses them, and ends.

use super::Panda;
use super::chain::Joints;
use super::checks::limits::Limits;
use super::control::{Hold, hand_at};
use super::motion::generator::{NotFinite, Surroundings};
use super::motion::{Ending, Motion};
use super::settings::Settings;
use crate::fci::{Answer, ControllerMode, ErrorKind, Errors, MoveStatus, RobotCommand};

impl Panda {
    /// Lets the motion follow a command or its loss. Returns the end of the motion, if it ends.
    pub(super) fn follow(&mut self, command: Option<&RobotCommand>) -> Option<Ending> {
        let motion = self.motion.as_mut()?;
        let tool = self.configuration.tool();
        let around = Surroundings { limits: &self.limits, tool: &tool, start_tolerance: self.settings.start_tolerance };
        let first = !motion.losses.has_begun();
        motion.cycles = motion.cycles.saturating_add(1);
        motion.losses.record(command.is_some());
        let Some(command) = command else {
            motion.torque_change = Joints::zeros();
            if !first {
                motion.generator.extrapolate(&around);
            }
            let lost = motion.losses.consecutive() >= self.settings.lost_command_horizon
                || (first && motion.cycles > self.settings.first_command_horizon);
            return lost.then(|| Ending::Reflex(Errors::of(ErrorKind::CommunicationConstraintsViolation)));
        };
        let mut errors = match motion.generator.follow(command, first, &around) {
            Ok(errors) => errors,
            Err(NotFinite) => return Some(Ending::InputError),
        };
        if motion.request.controller == ControllerMode::External {
            let torque = Joints::from(command.tau_j_d);
            if torque.iter().any(|t| !t.is_finite()) {
                return Some(Ending::InputError);
            }
            errors = errors.union(torque_errors(motion, &torque, &self.limits, &self.settings));
            if errors.is_empty() {
                motion.accept_torque(torque, self.configuration.gain(4));
            }
        }
        if errors.is_empty() && command.finished {
            return Some(self.finish());
        }
        (!errors.is_empty()).then_some(Ending::Reflex(errors))
    }

    /// End of a motion that its client finishes: a success if arm and path are at rest, and the arm is near the goal.
    fn finish(&self) -> Ending {
        let rest_speed = self.settings.rest_speed_rad_s;
        let Some(motion) = &self.motion else { return Ending::Success };
        let path = motion.generator.error_of_moving_end(rest_speed);
        let external = motion.request.controller == ControllerMode::External;
        let arm_moves = external && self.measured.readings.dq.amax() > rest_speed;
        let arm = arm_moves.then_some(ErrorKind::JointMotionGeneratorVelocityDiscontinuity);
        let off = self.deviates(&motion.request.goal_deviation).then_some(ErrorKind::MaxGoalPoseDeviationViolation);
        path.or(arm).or(off).map_or(Ending::Success, |kind| Ending::Reflex(Errors::of(kind)))
    }

    /// Returns true if an internal controller lets the arm deviate from the path: translation (m), rotation (rad), elbow (rad).
    pub(super) fn deviates(&self, [translation_m, rotation_rad, elbow_rad]: &[f64; 3]) -> bool {
        let Some(motion) = self.motion.as_ref().filter(|m| m.request.controller != ControllerMode::External) else {
            return false;
        };
        let desired = &motion.generator.joints().q;
        let step = self.measured.hand.step_to(&hand_at(desired, &self.configuration.tool()));
        step.fixed_rows::<3>(0).norm() > *translation_m
            || step.fixed_rows::<3>(3).norm() > *rotation_rad
            || (self.measured.readings.q[2] - desired[2]).abs() > *elbow_rad
    }

    /// Ends the running motion, answers its request and brings the arm to rest.
    pub(super) fn end_motion(&mut self, ending: Ending) {
        if let Some(motion) = self.motion.take() {
            self.answers.push((motion.id, Answer::Move(status_of(ending))));
            let external = motion.request.controller == ControllerMode::External;
            let path = motion.generator.joints();
            self.hold = match ending {
                Ending::Success | Ending::Preempted if !external => {
                    Hold::stop(path.q, path.dq, self.settings.stop_time_s)
                }
                _ => self.stop_here(),
            };
        }
        if let Ending::Reflex(errors) = ending {
            self.reflex = true;
            self.reflex_reason = errors;
            self.errors = self.errors.union(errors);
            self.contact.latch();
        }
    }

    pub(super) fn stop_here(&self) -> Hold {
        Hold::stop(self.measured.readings.q, self.measured.readings.dq, self.settings.stop_time_s)
    }
}

fn torque_errors(motion: &Motion, torque: &Joints, limits: &Limits, settings: &Settings) -> Errors {
    let mut errors = Errors::default();
    if limits.torque_jumps(&motion.commanded_torque, torque) {
        errors.insert(ErrorKind::ControllerTorqueDiscontinuity);
    }
    if settings.checks_torque_range && limits.torque_is_outside(torque) {
        errors.insert(ErrorKind::TauJRangeViolation);
    }
    errors
}

fn status_of(ending: Ending) -> MoveStatus {
    match ending {
        Ending::Success => MoveStatus::Success,
        Ending::Preempted => MoveStatus::Preempted,
        Ending::Reflex(_) => MoveStatus::ReflexAborted,
        Ending::UserStop => MoveStatus::EmergencyAborted,
        Ending::InputError => MoveStatus::InputErrorAborted,
        Ending::Aborted => MoveStatus::Aborted,
    }
}
