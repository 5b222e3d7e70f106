//! Layouts and numbers of version 5 (Panda, system 4.2.1 and newer).

use super::bytes::Writer;
use super::command::Command;
use super::state::put_modes;
use crate::fci::{MoveStatus, RecoveryStatus, RobotState, StopStatus};

/// Size of a robot state, bytes.
pub const STATE_BYTES: usize = 2373;
/// Size of a robot command, bytes.
pub const COMMAND_BYTES: usize = 370;
/// Size of the payload of `Move`, bytes.
pub const MOVE_BYTES: usize = 56;

/// Commands by their number.
pub const COMMANDS: [Command; 14] = [
    Command::Connect,
    Command::Move,
    Command::StopMove,
    Command::GetCartesianLimit,
    Command::SetCollisionBehavior,
    Command::SetJointImpedance,
    Command::SetCartesianImpedance,
    Command::SetGuidingMode,
    Command::SetEeToK,
    Command::SetNeToEe,
    Command::SetLoad,
    Command::SetFilters,
    Command::AutomaticErrorRecovery,
    Command::LoadModelLibrary,
];

/// Encodes a robot state. Returns the bytes written.
pub fn encode_state(s: &RobotState, datagram: &mut [u8]) -> usize {
    let mut w = Writer::new(datagram);
    w.put(&s.message_id.to_le_bytes());
    s.for_each_field(|numbers| numbers.iter().for_each(|number| w.put(&number.to_le_bytes())));
    put_modes(s, &mut w);
    w.put(&s.control_command_success_rate.to_le_bytes());
    w.position()
}

/// Number of the status of a `Move`.
pub fn move_status(status: MoveStatus) -> u8 {
    match status {
        MoveStatus::Success => 0,
        MoveStatus::MotionStarted => 1,
        MoveStatus::Preempted => 2,
        MoveStatus::CommandNotPossibleRejected => 3,
        MoveStatus::StartAtSingularPoseRejected => 4,
        MoveStatus::InvalidArgumentRejected => 5,
        MoveStatus::ReflexAborted => 6,
        MoveStatus::EmergencyAborted => 7,
        MoveStatus::InputErrorAborted => 8,
        MoveStatus::Aborted => 9,
    }
}

/// Number of the status of a `StopMove`.
pub fn stop_status(status: StopStatus) -> u8 {
    match status {
        StopStatus::Success => 0,
        StopStatus::CommandNotPossibleRejected => 1,
        StopStatus::EmergencyAborted => 2,
        StopStatus::ReflexAborted => 3,
        StopStatus::Aborted => 4,
    }
}

/// Number of the status of an `AutomaticErrorRecovery`.
pub fn recovery_status(status: RecoveryStatus) -> u8 {
    match status {
        RecoveryStatus::Success => 0,
        RecoveryStatus::CommandNotPossibleRejected => 1,
        RecoveryStatus::ManualErrorRecoveryRequiredRejected => 2,
        RecoveryStatus::ReflexAborted => 3,
        RecoveryStatus::EmergencyAborted => 4,
        RecoveryStatus::Aborted => 5,
    }
}
