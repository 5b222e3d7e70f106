//! Requests and answers over TCP.

use super::bytes::Reader;
use super::command::Command;
use super::error::{HEADER_BYTES, REQUEST_BYTES_MAX, WireError};
use super::{v5, v10};
use crate::fci::{
    Answer, CollisionThresholds, ControllerMode, Generation, Generator, Load, ModelLibrary, MoveRequest, MoveStatus,
    Request, SetterStatus,
};

/// Size of the payload, bytes.
fn payload_bytes(command: Command, generation: Generation) -> usize {
    match command {
        Command::StopMove | Command::AutomaticErrorRecovery | Command::GetRobotModel => 0,
        Command::Connect | Command::GetCartesianLimit => 4,
        Command::Move => match generation {
            Generation::Panda => v5::MOVE_BYTES,
            Generation::Fr3 => v10::MOVE_BYTES,
        },
        Command::SetCollisionBehavior => 52 * 8,
        Command::SetJointImpedance => 7 * 8,
        Command::SetCartesianImpedance => 6 * 8,
        Command::SetGuidingMode => 7,
        Command::SetEeToK | Command::SetNeToEe => 16 * 8,
        Command::SetLoad => 13 * 8,
        Command::SetFilters => 5 * 8,
        Command::LoadModelLibrary => 2,
    }
}

fn commands(generation: Generation) -> &'static [Command] {
    match generation {
        Generation::Panda => &v5::COMMANDS,
        Generation::Fr3 => &v10::COMMANDS,
    }
}

/// Number of a command. A command that the version lacks has none: its answer gets the largest number, which no client knows.
fn number_of(generation: Generation, command: Command) -> u32 {
    commands(generation).iter().zip(0..).find(|(c, _)| **c == command).map_or(u32::MAX, |(_, number)| number)
}

/// Header of a request or an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Number of the command.
    pub command: u32,
    /// Identifier of the request, which its answers repeat.
    pub id: u32,
    /// Size of the message with its header, bytes.
    pub size: u32,
}

impl Header {
    /// Reads the header of a request; `None` if fewer bytes than a header have come.
    ///
    /// # Errors
    /// [`WireError::Size`] if its size is out of range.
    pub fn decode(bytes: &[u8]) -> Result<Option<Self>, WireError> {
        if bytes.len() < HEADER_BYTES {
            return Ok(None);
        }
        let mut r = Reader::new(bytes);
        let header = Self { command: r.u32(), id: r.u32(), size: r.u32() };
        // The constant is small.
        if header.size < HEADER_BYTES as u32 || header.size > REQUEST_BYTES_MAX {
            return Err(WireError::Size { command: header.command, size: header.size });
        }
        Ok(Some(header))
    }

    fn encode(self, out: &mut Vec<u8>) {
        for number in [self.command, self.id, self.size] {
            out.extend_from_slice(&number.to_le_bytes());
        }
    }
}

/// Message of a client.
#[derive(Debug, Clone, PartialEq)]
pub enum ClientMessage {
    /// Opens a session.
    Connect {
        /// Version of the client.
        version: u16,
        /// Port of the client for states.
        udp_port: u16,
    },
    /// Request within a session.
    Request(Box<Request>),
}

/// Command whose request has an invalid value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refusal {
    /// Number of the command.
    pub command: u32,
    /// Identifier of the request.
    pub id: u32,
}

/// Decodes a message.
///
/// # Errors
/// Unknown command, wrong length, value that is not finite or out of its enumeration.
pub fn decode_message(generation: Generation, command: u32, payload: &[u8]) -> Result<ClientMessage, WireError> {
    let unknown = WireError::UnknownCommand { version: generation.fci_version(), command };
    let command = *commands(generation).get(command as usize).ok_or(unknown)?;
    let expected = payload_bytes(command, generation);
    if payload.len() != expected {
        return Err(WireError::Length { what: command.name(), expected, got: payload.len() });
    }
    let mut r = Reader::new(payload);
    let request = match command {
        Command::Connect => return Ok(ClientMessage::Connect { version: r.u16(), udp_port: r.u16() }),
        Command::Move => Request::Move(move_request(generation, &mut r)?),
        Command::StopMove => Request::StopMove,
        Command::GetCartesianLimit => Request::GetCartesianLimit(r.i32()),
        Command::SetCollisionBehavior => Request::SetCollisionBehavior(CollisionThresholds {
            lower_torques_acceleration: finite(command, r.f64s())?,
            upper_torques_acceleration: finite(command, r.f64s())?,
            lower_torques_nominal: finite(command, r.f64s())?,
            upper_torques_nominal: finite(command, r.f64s())?,
            lower_forces_acceleration: finite(command, r.f64s())?,
            upper_forces_acceleration: finite(command, r.f64s())?,
            lower_forces_nominal: finite(command, r.f64s())?,
            upper_forces_nominal: finite(command, r.f64s())?,
        }),
        Command::SetJointImpedance => Request::SetJointImpedance(finite(command, r.f64s())?),
        Command::SetCartesianImpedance => Request::SetCartesianImpedance(finite(command, r.f64s())?),
        Command::SetGuidingMode => Request::SetGuidingMode(std::array::from_fn(|_| r.bool()), r.bool()),
        Command::SetEeToK => Request::SetEeToK(finite(command, r.f64s())?),
        Command::SetNeToEe => Request::SetNeToEe(finite(command, r.f64s())?),
        Command::SetLoad => {
            let [mass_kg] = finite(command, r.f64s())?;
            Request::SetLoad(Load {
                mass_kg,
                centre_m: finite(command, r.f64s())?,
                inertia: finite(command, r.f64s())?,
            })
        }
        Command::SetFilters => Request::SetFilters(finite(command, r.f64s())?),
        Command::AutomaticErrorRecovery => Request::AutomaticErrorRecovery,
        Command::LoadModelLibrary => Request::LoadModelLibrary(ModelLibrary { architecture: r.u8(), system: r.u8() }),
        Command::GetRobotModel => Request::GetRobotModel,
    };
    Ok(ClientMessage::Request(Box::new(request)))
}

fn move_request(generation: Generation, r: &mut Reader) -> Result<MoveRequest, WireError> {
    let controller = match r.u32() {
        0 => ControllerMode::JointImpedance,
        1 => ControllerMode::CartesianImpedance,
        2 => ControllerMode::External,
        _ => return Err(WireError::Value { what: "controller of Move", expected: "expected 0 to 2" }),
    };
    let generator = match r.u32() {
        0 => Generator::JointPosition,
        1 => Generator::JointVelocity,
        2 => Generator::CartesianPosition,
        3 => Generator::CartesianVelocity,
        4 if generation == Generation::Fr3 => Generator::None,
        _ => {
            return Err(WireError::Value {
                what: "motion generator of Move",
                expected: "expected 0 to 3, FCI 10: to 4",
            });
        }
    };
    let path_deviation = finite(Command::Move, r.f64s())?;
    let goal_deviation = finite(Command::Move, r.f64s())?;
    if generation == Generation::Fr3 && r.bool() {
        return Err(WireError::Value { what: "asynchronous motion of Move", expected: "this server has none" });
    }
    Ok(MoveRequest { controller, generator, path_deviation, goal_deviation })
}

fn finite<const N: usize>(command: Command, numbers: [f64; N]) -> Result<[f64; N], WireError> {
    if numbers.iter().all(|number| number.is_finite()) {
        Ok(numbers)
    } else {
        Err(WireError::Value { what: command.name(), expected: "expected finite numbers" })
    }
}

fn message(command: u32, id: u32, payload: &[&[u8]], out: &mut Vec<u8>) {
    let bytes = HEADER_BYTES + payload.iter().map(|part| part.len()).sum::<usize>();
    // Model libraries have less than a megabyte.
    Header { command, id, size: u32::try_from(bytes).unwrap_or(u32::MAX) }.encode(out);
    payload.iter().for_each(|part| out.extend_from_slice(part));
}

/// Encodes the answer to `Connect`: the version of the server, and acceptance or refusal of the client's.
pub fn encode_connect(generation: Generation, id: u32, accepted: bool, out: &mut Vec<u8>) {
    message(0, id, &[&[u8::from(!accepted)], &generation.fci_version().to_le_bytes()], out);
}

/// Encodes the answer "invalid argument" to a request whose values are invalid. Returns false if its command has no such answer.
pub fn encode_refusal(generation: Generation, refusal: Refusal, out: &mut Vec<u8>) -> bool {
    let Refusal { command, id } = refusal;
    let Some(kind) = commands(generation).get(command as usize) else { return false };
    let status = match kind {
        Command::Move => move_status(generation, MoveStatus::InvalidArgumentRejected),
        Command::Connect
        | Command::StopMove
        | Command::AutomaticErrorRecovery
        | Command::LoadModelLibrary
        | Command::GetRobotModel => return false,
        _ => setter_status(SetterStatus::InvalidArgumentRejected),
    };
    message(command, id, &[&[status]], out);
    true
}

/// Name of a request, as libfranka writes it.
#[must_use]
pub fn request_name(request: &Request) -> &'static str {
    command_of(request).name()
}

/// Encodes an answer.
pub fn encode_answer(generation: Generation, id: u32, answer: &Answer, out: &mut Vec<u8>) {
    let mut put = |command, payload: &[&[u8]]| message(number_of(generation, command), id, payload, out);
    match answer {
        Answer::Move(status) => put(Command::Move, &[&[move_status(generation, *status)]]),
        Answer::Stop(status) => put(
            Command::StopMove,
            &[&[match generation {
                Generation::Panda => v5::stop_status(*status),
                Generation::Fr3 => v10::stop_status(*status),
            }]],
        ),
        Answer::Setter(request, status) => put(command_of(request), &[&[setter_status(*status)]]),
        Answer::CartesianLimit(status, size_m, frame, active) => {
            let mut numbers = [0; 19 * 8];
            for (place, number) in numbers.chunks_exact_mut(8).zip(size_m.iter().chain(frame)) {
                place.copy_from_slice(&number.to_le_bytes());
            }
            put(Command::GetCartesianLimit, &[&[setter_status(*status)], &numbers, &[u8::from(*active)]]);
        }
        Answer::Recovery(status) => put(
            Command::AutomaticErrorRecovery,
            &[&[match generation {
                Generation::Panda => v5::recovery_status(*status),
                Generation::Fr3 => v10::recovery_status(*status),
            }]],
        ),
        Answer::ModelLibrary(Some(library)) => put(Command::LoadModelLibrary, &[&[0], library]),
        Answer::ModelLibrary(None) => put(Command::LoadModelLibrary, &[&[1]]),
        Answer::RobotModel(urdf) => put(Command::GetRobotModel, &[&[0], urdf.as_bytes()]),
    }
}

fn move_status(generation: Generation, status: MoveStatus) -> u8 {
    match generation {
        Generation::Panda => v5::move_status(status),
        Generation::Fr3 => v10::move_status(status),
    }
}

fn setter_status(status: SetterStatus) -> u8 {
    match status {
        SetterStatus::Success => 0,
        SetterStatus::CommandNotPossibleRejected => 1,
        SetterStatus::InvalidArgumentRejected => 2,
    }
}

fn command_of(request: &Request) -> Command {
    match request {
        Request::Move(_) => Command::Move,
        Request::StopMove => Command::StopMove,
        Request::GetCartesianLimit(_) => Command::GetCartesianLimit,
        Request::SetCollisionBehavior(_) => Command::SetCollisionBehavior,
        Request::SetJointImpedance(_) => Command::SetJointImpedance,
        Request::SetCartesianImpedance(_) => Command::SetCartesianImpedance,
        Request::SetGuidingMode(..) => Command::SetGuidingMode,
        Request::SetEeToK(_) => Command::SetEeToK,
        Request::SetNeToEe(_) => Command::SetNeToEe,
        Request::SetLoad(_) => Command::SetLoad,
        Request::SetFilters(_) => Command::SetFilters,
        Request::AutomaticErrorRecovery => Command::AutomaticErrorRecovery,
        Request::LoadModelLibrary(_) => Command::LoadModelLibrary,
        Request::GetRobotModel => Command::GetRobotModel,
    }
}
