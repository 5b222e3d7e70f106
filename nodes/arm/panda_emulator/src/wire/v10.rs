//! Layouts and numbers of version 10 (Franka Research 3, system 5.9 and newer).
//!
//! Numbers of a state are f32. Statuses of a `Move`, `StopMove` and recovery have numbers for safety functions, which no Panda has.

use super::bytes::Writer;
use super::command::Command;
use super::state::put_modes;
use crate::fci::{MoveStatus, RecoveryStatus, RobotState, StopStatus};

/// Size of a robot state, bytes.
pub const STATE_BYTES: usize = 1377;
/// Size of a robot command, bytes.
pub const COMMAND_BYTES: usize = 371;
/// Size of the payload of `Move`, bytes: that of version 5, a flag of asynchronous motions, and their seven speeds.
pub const MOVE_BYTES: usize = 113;
/// Numbers of the accelerometers: two blocks of six sensors with three axes. The emulated arm has none, so that they are zero.
const ACCELEROMETERS: usize = 36;

/// Commands by their number.
pub const COMMANDS: [Command; 12] = [
    Command::Connect,
    Command::Move,
    Command::StopMove,
    Command::SetCollisionBehavior,
    Command::SetJointImpedance,
    Command::SetCartesianImpedance,
    Command::SetGuidingMode,
    Command::SetEeToK,
    Command::SetNeToEe,
    Command::SetLoad,
    Command::AutomaticErrorRecovery,
    Command::GetRobotModel,
];

/// Encodes a robot state. Returns the bytes written.
#[expect(clippy::cast_possible_truncation, reason = "the layout has f32")]
pub fn encode_state(s: &RobotState, datagram: &mut [u8]) -> usize {
    let mut w = Writer::new(datagram);
    w.put(&s.message_id.to_le_bytes());
    s.for_each_field(|numbers| numbers.iter().for_each(|number| w.put(&(*number as f32).to_le_bytes())));
    (0..ACCELEROMETERS).for_each(|_| w.put(&0.0_f32.to_le_bytes()));
    put_modes(s, &mut w);
    w.put(&(s.control_command_success_rate as f32).to_le_bytes());
    w.position()
}

/// Number of the status of a `Move`.
pub fn move_status(status: MoveStatus) -> u8 {
    match status {
        MoveStatus::Success => 0,
        MoveStatus::MotionStarted => 1,
        MoveStatus::Preempted => 2,
        MoveStatus::CommandNotPossibleRejected => 5,
        MoveStatus::StartAtSingularPoseRejected => 6,
        MoveStatus::InvalidArgumentRejected => 7,
        MoveStatus::ReflexAborted => 8,
        MoveStatus::EmergencyAborted => 9,
        MoveStatus::InputErrorAborted => 10,
        MoveStatus::Aborted => 11,
    }
}

/// Number of the status of a `StopMove`.
pub fn stop_status(status: StopStatus) -> u8 {
    match status {
        StopStatus::Success => 0,
        StopStatus::CommandNotPossibleRejected => 1,
        StopStatus::EmergencyAborted => 3,
        StopStatus::ReflexAborted => 4,
        StopStatus::Aborted => 5,
    }
}

/// Number of the status of an `AutomaticErrorRecovery`.
pub fn recovery_status(status: RecoveryStatus) -> u8 {
    match status {
        RecoveryStatus::Success => 0,
        RecoveryStatus::CommandNotPossibleRejected => 1,
        RecoveryStatus::ManualErrorRecoveryRequiredRejected => 3,
        RecoveryStatus::ReflexAborted => 4,
        RecoveryStatus::EmergencyAborted => 5,
        RecoveryStatus::Aborted => 6,
    }
}
