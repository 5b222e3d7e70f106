//! Access to a running server from other threads.

use super::events::{Event, EventLog};
use super::network::Fault;
use crate::fci::{IDENTITY, RobotMode};
use crate::panda::Wall;
use catenary_core::durations::Durations;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Change that a handle asks for. It takes effect with the next cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Input {
    UserStop(bool),
    Brakes(bool),
    Guiding(bool),
    Push([f64; 6]),
    Wall(Option<Wall>),
    Fault(Fault),
    Crash,
}

/// Arm and session after a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshot {
    /// Clock of the control box, ms.
    pub message_id: u64,
    /// Mode of the control box.
    pub mode: RobotMode,
    /// Address of the client, if one is connected.
    pub client: Option<SocketAddr>,
    /// True pose of the hand, column-major.
    pub hand_pose: [f64; 16],
    /// True twist of the hand: m/s, then rad/s.
    pub hand_twist: [f64; 6],
    /// True joint positions, rad.
    pub q_rad: [f64; 7],
    /// True joint velocities, rad/s.
    pub dq_rad_s: [f64; 7],
    /// Cycles that the server left out because the machine was too slow for 1 kHz.
    pub cycles_left_out: u64,
}

impl Default for Snapshot {
    fn default() -> Self {
        Self {
            message_id: 0,
            mode: RobotMode::default(),
            client: None,
            hand_pose: IDENTITY,
            hand_twist: [0.0; 6],
            q_rad: [0.0; 7],
            dq_rad_s: [0.0; 7],
            cycles_left_out: 0,
        }
    }
}

/// State that the server's thread and the handles share.
#[derive(Debug, Default)]
pub(super) struct Shared {
    stopped: AtomicBool,
    inputs: Mutex<Vec<Input>>,
    snapshot: Mutex<Snapshot>,
    responses: Mutex<Durations>,
    log: Mutex<EventLog>,
    failure: Mutex<Option<String>>,
}

impl Shared {
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Takes the inputs that wait.
    pub fn take_inputs(&self) -> Vec<Input> {
        std::mem::take(&mut *lock(&self.inputs))
    }

    pub fn publish(&self, snapshot: Snapshot) {
        *lock(&self.snapshot) = snapshot;
    }

    /// Adds the time from a state to the command that answers it.
    pub fn respond(&self, time: Duration) {
        lock(&self.responses).add(time);
    }

    /// Records the panic that ended the server's thread.
    pub fn fail(&self, panic: String) {
        *lock(&self.failure) = Some(panic);
    }

    /// Moves events to the log that handles read.
    pub fn log(&self, log: &mut EventLog) {
        if !log.is_empty() {
            let mut shared = lock(&self.log);
            log.take().into_iter().for_each(|(message_id, event)| shared.push(message_id, event));
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // Each value is written whole, so that a thread that panicked leaves a valid one.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Handle of a running server: hands on the robot, and the truth that no client sees.
#[derive(Debug, Clone)]
pub struct Handle {
    shared: Arc<Shared>,
}

impl Handle {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        Self { shared }
    }

    pub(super) fn stop(&self) {
        self.shared.stopped.store(true, Ordering::Relaxed);
    }

    fn input(&self, input: Input) {
        lock(&self.shared.inputs).push(input);
    }

    /// Presses or releases the user stop.
    pub fn set_user_stop(&self, pressed: bool) {
        self.input(Input::UserStop(pressed));
    }

    /// Opens or closes the brakes.
    pub fn set_brakes(&self, open: bool) {
        self.input(Input::Brakes(open));
    }

    /// Presses or releases both buttons at the flange.
    pub fn set_guiding(&self, pressed: bool) {
        self.input(Input::Guiding(pressed));
    }

    /// Pushes the hand with a wrench in O, N and N m, until the next call.
    pub fn push(&self, wrench: [f64; 6]) {
        self.input(Input::Push(wrench));
    }

    /// Puts a wall in the way of the hand, or takes it away.
    pub fn set_wall(&self, wall: Option<Wall>) {
        self.input(Input::Wall(wall));
    }

    /// Adds a fault of the network.
    pub fn inject(&self, fault: Fault) {
        self.input(Input::Fault(fault));
    }

    /// Has the server's thread panic, for tests of what supervises a server.
    pub fn crash(&self) {
        self.input(Input::Crash);
    }

    /// Panic that ended the server's thread; `None` while it runs. Its address is free again, and the snapshot is the last one.
    ///
    /// A process that serves an arm must end then, so that what supervises it starts another one.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        lock(&self.shared.failure).clone()
    }

    /// Arm and session after the last cycle.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        *lock(&self.shared.snapshot)
    }

    /// Takes the times from a state to the command that answers it, since the last call.
    #[must_use]
    pub fn take_responses(&self) -> Durations {
        std::mem::take(&mut *lock(&self.shared.responses))
    }

    /// Takes the events since the last call: clock of the control box in ms, and event.
    #[must_use]
    pub fn take_events(&self) -> Vec<(u64, Event)> {
        lock(&self.shared.log).take()
    }
}
