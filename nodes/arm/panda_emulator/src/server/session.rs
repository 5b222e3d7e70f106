//! Session of one client with the control box. It does no input or output: bytes come in, bytes and states go out.

use super::events::{Event, EventLog};
use crate::Panda;
use crate::fci::{
    Answer, Errors, Generation, ModelLibrary, MoveStatus, Request, RobotCommand, RobotMode, RobotState, SetterStatus,
};
use crate::wire::{self, ClientMessage, Header, Refusal, WireError};

/// Bytes of answers that may wait for a client beside its model. Chosen: 5000 statuses.
const BACKLOG_BYTES: usize = 1 << 16;

/// Result of received bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reception {
    /// The session goes on.
    Continue,
    /// The client connected: states go to this port.
    Connected {
        /// UDP port of the client.
        udp_port: u16,
    },
    /// The session is over. The answers so far are sent, then the connection is closed.
    Close,
}

/// Control box and its session.
#[derive(Debug)]
pub struct Session {
    /// Arm and control box.
    pub panda: Panda,
    /// Happenings.
    pub log: EventLog,
    model_library: Option<Vec<u8>>,
    /// Bytes of a request that is not complete.
    inbox: Vec<u8>,
    connected: bool,
    command: Option<RobotCommand>,
    cycle_is_answered: bool,
    motion_has_command: bool,
    mode: RobotMode,
    reflex_reason: Errors,
    /// The arm was put back in the last cycle.
    was_restored: bool,
}

impl Session {
    /// Control box without a client.
    ///
    /// `model_library` is the shared library for clients on x86-64 Linux; without one, `LoadModelLibrary` is answered with an error.
    #[must_use]
    pub fn new(panda: Panda, model_library: Option<Vec<u8>>) -> Self {
        let mode = panda.state().robot_mode;
        Self {
            panda,
            log: EventLog::default(),
            model_library,
            inbox: Vec::new(),
            connected: false,
            command: None,
            cycle_is_answered: false,
            motion_has_command: false,
            mode,
            reflex_reason: Errors::default(),
            was_restored: false,
        }
    }

    fn generation(&self) -> Generation {
        self.panda.settings().generation
    }

    /// Ends the session: the client closed its connection, or is silent.
    pub fn leave(&mut self) {
        self.inbox.clear();
        self.command = None;
        self.motion_has_command = false;
        if std::mem::take(&mut self.connected) {
            self.panda.client_left();
            // Answers to a client that left go nowhere.
            for (_, answer) in self.panda.take_answers() {
                self.log_answer(&answer);
            }
            self.log_event(Event::ClientLeft);
        }
    }

    /// Bytes of answers that may wait for a client: a second model may be asked for before the first is read.
    fn most_waiting_bytes(&self) -> usize {
        let model = self.model_library.as_ref().map_or(0, Vec::len).max(franka::model::FR3_URDF.len());
        BACKLOG_BYTES + 2 * model
    }

    /// Takes bytes from TCP. Answers are appended to `out`, which holds those that the client has not taken yet. A client that lets more
    /// wait than two models and some statuses is dropped.
    pub fn receive(&mut self, bytes: &[u8], out: &mut Vec<u8>) -> Reception {
        self.inbox.extend_from_slice(bytes);
        let mut reception = Reception::Continue;
        loop {
            match self.next_message(out) {
                Ok(None) => return reception,
                // After each request: a few bytes may ask for megabytes.
                Ok(Some(_)) if out.len() > self.most_waiting_bytes() => {
                    self.log_event(Event::ClientTooSlow { bytes: out.len() });
                    return Reception::Close;
                }
                Ok(Some(Reception::Continue)) => {}
                Ok(Some(Reception::Close)) => return Reception::Close,
                Ok(Some(connected)) => reception = connected,
                Err(error) => {
                    self.log_event(Event::Malformed(error));
                    return Reception::Close;
                }
            }
        }
    }

    fn next_message(&mut self, out: &mut Vec<u8>) -> Result<Option<Reception>, WireError> {
        let Some(header) = Header::decode(&self.inbox)? else { return Ok(None) };
        let size = header.size as usize;
        if self.inbox.len() < size {
            return Ok(None);
        }
        let message = wire::decode_message(self.generation(), header.command, &self.inbox[wire::HEADER_BYTES..size]);
        self.inbox.drain(..size);
        match message {
            Ok(ClientMessage::Connect { version, udp_port }) => {
                Ok(Some(self.connect(header.id, version, udp_port, out)))
            }
            // A session begins with Connect. libfranka and franka-rs send nothing before.
            _ if !self.connected => Ok(Some(Reception::Close)),
            Ok(ClientMessage::Request(request)) => {
                self.request(header.id, &request, out);
                Ok(Some(Reception::Continue))
            }
            Err(error @ WireError::Value { .. }) => {
                let refusal = Refusal { command: header.command, id: header.id };
                if !wire::encode_refusal(self.generation(), refusal, out) {
                    return Err(error);
                }
                self.log_event(Event::Malformed(error));
                Ok(Some(Reception::Continue))
            }
            Err(error) => Err(error),
        }
    }

    fn connect(&mut self, id: u32, version: u16, udp_port: u16, out: &mut Vec<u8>) -> Reception {
        let accepted = version == self.generation().fci_version();
        if self.connected {
            return Reception::Close;
        }
        wire::encode_connect(self.generation(), id, accepted, out);
        if accepted {
            self.connected = true;
            Reception::Connected { udp_port }
        } else {
            self.log_event(Event::VersionRefused { client: version, server: self.generation().fci_version() });
            Reception::Close
        }
    }

    fn request(&mut self, id: u32, request: &Request, out: &mut Vec<u8>) {
        match request {
            Request::LoadModelLibrary(wanted) => {
                let answer = Answer::ModelLibrary(self.library_for(*wanted));
                wire::encode_answer(self.generation(), id, &answer, out);
            }
            Request::GetRobotModel => {
                let answer = Answer::RobotModel(franka::model::FR3_URDF.to_owned());
                wire::encode_answer(self.generation(), id, &answer, out);
            }
            request => {
                self.panda.request(id, request);
                self.take_answers(out);
            }
        }
    }

    /// Shared library for the client's machine. Architecture 0 is x86-64, system 0 is Linux; there is none for others.
    fn library_for(&self, wanted: ModelLibrary) -> Option<Vec<u8>> {
        let has_one = wanted == ModelLibrary { architecture: 0, system: 0 };
        self.model_library.clone().filter(|_| has_one)
    }

    /// Takes a datagram from the client. The newest command that answers the newest state counts; others are ignored.
    ///
    /// An empty datagram ends the wait of the lock step without a command. No robot has it; it lets a client drop commands.
    pub fn receive_datagram(&mut self, datagram: &[u8]) {
        if datagram.is_empty() {
            self.cycle_is_answered = true;
            return;
        }
        match wire::decode_command(self.generation(), datagram) {
            Ok(command) => {
                self.motion_has_command |= self.panda.state().motion.is_some();
                if command.message_id == self.panda.state().message_id {
                    self.command = Some(command);
                    self.cycle_is_answered = true;
                }
            }
            Err(error) => self.log_event(Event::Malformed(error)),
        }
    }

    /// Ends the wait for a command in this cycle.
    pub fn skip_command(&mut self) {
        self.cycle_is_answered = true;
    }

    /// Lets the motion count as one without a first command, so that the lock step waits for none.
    pub fn give_up_waiting(&mut self) {
        self.motion_has_command = false;
    }

    /// Returns true if the lock step holds: a motion runs, and its first command came.
    #[must_use]
    pub fn is_stepped(&self) -> bool {
        self.connected && self.motion_has_command && self.panda.state().motion.is_some()
    }

    /// Returns true if the lock step waits for the command that answers the newest state.
    #[must_use]
    pub fn waits_for_command(&self) -> bool {
        self.is_stepped() && !self.cycle_is_answered
    }

    /// Returns true if a client is connected.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.connected
    }

    /// Runs one cycle. Answers are appended to `out`. Returns the new state.
    pub fn cycle(&mut self, out: &mut Vec<u8>) -> &RobotState {
        self.panda.cycle(self.command.take().as_ref());
        self.cycle_is_answered = false;
        self.take_answers(out);
        let state = self.panda.state();
        self.motion_has_command &= state.motion.is_some();
        let (mode, reason) = (state.robot_mode, state.reflex_reason);
        if mode != std::mem::replace(&mut self.mode, mode) {
            self.log_event(Event::Mode(mode));
        }
        if reason != std::mem::replace(&mut self.reflex_reason, reason) && !reason.is_empty() {
            self.log_event(Event::Reflex(reason));
        }
        let restored = self.panda.was_restored();
        // Once: a cause that lasts has the simulation diverge in every cycle.
        if restored && !std::mem::replace(&mut self.was_restored, restored) {
            self.log_event(Event::Restored);
        }
        self.was_restored = restored;
        self.panda.state()
    }

    fn take_answers(&mut self, out: &mut Vec<u8>) {
        for (id, answer) in self.panda.take_answers() {
            wire::encode_answer(self.generation(), id, &answer, out);
            self.log_answer(&answer);
        }
    }

    fn log_answer(&mut self, answer: &Answer) {
        match answer {
            Answer::Move(MoveStatus::MotionStarted) => self.log_event(Event::MotionStarted),
            Answer::Move(status) => self.log_event(Event::MotionEnded(*status)),
            Answer::Setter(request, status) if *status != SetterStatus::Success => {
                self.log_event(Event::SetterRefused(wire::request_name(request), *status));
            }
            Answer::Recovery(status) => self.log_event(Event::Recovery(*status)),
            _ => {}
        }
    }

    /// Logs an event at the clock of the control box.
    pub fn log_event(&mut self, event: Event) {
        self.log.push(self.panda.state().message_id, event);
    }
}

#[cfg(test)]
mod tests;
