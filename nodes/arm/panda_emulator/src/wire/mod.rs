//! Byte layouts of the Franka Control Interface, versions 5 and 10. Packed, little-endian.
//!
//! Source of version 5: headers of libfranka 0.9.2 (`research_interface/robot`). Source of version 10: those of libfranka 0.21.2.

mod bytes;
mod command;
mod error;
mod messages;
mod state;
mod v10;
mod v5;

pub use error::{HEADER_BYTES, REQUEST_BYTES_MAX, WireError};
pub use messages::{
    ClientMessage, Header, Refusal, decode_message, encode_answer, encode_connect, encode_refusal, request_name,
};

use crate::fci::{Generation, RobotCommand, RobotState};
use bytes::Reader;

/// Size of the largest robot state, bytes.
pub const STATE_BYTES_MAX: usize = v5::STATE_BYTES;
/// Size of a robot state, bytes.
#[must_use]
pub fn state_bytes(generation: Generation) -> usize {
    match generation {
        Generation::Panda => v5::STATE_BYTES,
        Generation::Fr3 => v10::STATE_BYTES,
    }
}

/// Encodes a robot state into the buffer, without allocation. Returns the datagram.
pub fn encode_state<'a>(generation: Generation, state: &RobotState, buffer: &'a mut [u8; STATE_BYTES_MAX]) -> &'a [u8] {
    let datagram = &mut buffer[..state_bytes(generation)];
    match generation {
        Generation::Panda => v5::encode_state(state, datagram),
        Generation::Fr3 => v10::encode_state(state, datagram),
    };
    datagram
}

/// Decodes a robot command.
///
/// Numbers that are not finite pass: the control box judges them by the running motion, whose channels alone count.
///
/// # Errors
/// [`WireError::Length`] if the datagram has another length than the version's command.
pub fn decode_command(generation: Generation, datagram: &[u8]) -> Result<RobotCommand, WireError> {
    let expected = match generation {
        Generation::Panda => v5::COMMAND_BYTES,
        Generation::Fr3 => v10::COMMAND_BYTES,
    };
    if datagram.len() != expected {
        return Err(WireError::Length { what: "robot command", expected, got: datagram.len() });
    }
    let mut r = Reader::new(datagram);
    let (message_id, q_c, dq_c, o_t_ee_c, o_dp_ee_c) = (r.u64(), r.f64s(), r.f64s(), r.f64s(), r.f64s());
    let (elbow, valid_elbow, motion_finished, tau_j_d) = (r.f64s(), r.bool(), r.bool(), r.f64s());
    // Version 10 adds a flag for motions without a generator.
    let torque_finished = generation == Generation::Fr3 && r.bool();
    Ok(RobotCommand {
        message_id,
        q_c,
        dq_c,
        o_t_ee_c,
        o_dp_ee_c,
        elbow_c: valid_elbow.then_some(elbow),
        tau_j_d,
        finished: motion_finished || torque_finished,
    })
}

#[cfg(test)]
mod tests;
