//! Data that the threads of a connection share.

use super::figures::LoopFigures;
use super::hangup::HangUp;
use crate::compliance::Compliance;
use crate::law::Joints;
use franka::{Robot, RobotState};
use nalgebra::Isometry3;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU16, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Phase of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading states; no motion.
    Monitoring,
    /// A motion follows its target.
    Following,
    /// A motion comes to rest before its end.
    Stopping,
}

/// Newest state of the robot.
#[derive(Debug, Clone, Copy)]
pub struct Measured {
    /// State.
    pub state: RobotState,
    /// Arrival.
    pub at: Instant,
    /// Phase in which it arrived.
    pub phase: Phase,
}

/// Orders to the control thread.
#[derive(Debug, Clone, Copy)]
pub struct Orders {
    /// True: a motion runs. False: it comes to rest and ends.
    pub follow: bool,
    /// Target of the end effector; `None` holds the pose at the start of the motion.
    pub target: Option<Isometry3<f64>>,
    /// Posture of the arm, kept from motion to motion, rad; `None` before the first motion.
    pub posture: Option<Joints>,
    /// Number of holds so far. A new one makes the arm brake where it is.
    pub holds: u64,
    /// Stiffness, damping and error clip.
    pub compliance: Compliance,
    /// Last call of the node.
    pub refreshed: Instant,
}

/// End of a motion that nobody asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// User stop.
    UserStop,
    /// Reflex or refusal, with its names or its reason.
    Fault(String),
}

/// Shared data. No lock is held while a thread waits for the robot.
pub struct Shared {
    orders: Mutex<Orders>,
    measured: Mutex<Option<Measured>>,
    figures: Mutex<LoopFigures>,
    problem: Mutex<String>,
    ended: Mutex<Option<End>>,
    robot: Mutex<Option<Arc<Robot>>>,
    hang_up: Mutex<Option<HangUp>>,
    /// Number of states that the control thread has read, and of its other signs of life.
    pub beats: AtomicU64,
    /// True once the link was dropped.
    pub ending: AtomicBool,
    /// True while thresholds and load of this connection are set.
    pub configured: AtomicBool,
    /// Version of FCI that the robot's server speaks.
    pub server_version: AtomicU16,
    asking_since: Mutex<Option<Instant>>,
    address: Mutex<Option<SocketAddr>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Creates the data of a link without a connection.
    pub fn new(compliance: Compliance) -> Self {
        let orders =
            Orders { follow: false, target: None, posture: None, holds: 0, compliance, refreshed: Instant::now() };
        Self {
            orders: Mutex::new(orders),
            measured: Mutex::new(None),
            figures: Mutex::new(LoopFigures::default()),
            problem: Mutex::new("not connected yet".to_owned()),
            ended: Mutex::new(None),
            robot: Mutex::new(None),
            hang_up: Mutex::new(None),
            beats: AtomicU64::new(0),
            ending: AtomicBool::new(false),
            configured: AtomicBool::new(false),
            server_version: AtomicU16::new(0),
            asking_since: Mutex::new(None),
            address: Mutex::new(None),
        }
    }

    /// Locks the orders.
    pub fn orders(&self) -> MutexGuard<'_, Orders> {
        lock(&self.orders)
    }

    /// Copies the orders to `into`, unless another thread holds them: the control thread waits for nobody.
    pub fn read_orders(&self, into: &mut Orders) {
        if let Ok(orders) = self.orders.try_lock() {
            *into = *orders;
        }
    }

    /// Locks the newest state.
    pub fn measured(&self) -> MutexGuard<'_, Option<Measured>> {
        lock(&self.measured)
    }

    /// Records a state, unless a reader holds the last one: the next state follows in a millisecond.
    pub fn record(&self, state: &RobotState, phase: Phase) {
        self.beats.fetch_add(1, Ordering::Relaxed);
        if let Ok(mut measured) = self.measured.try_lock() {
            *measured = Some(Measured { state: *state, at: Instant::now(), phase });
        }
    }

    /// Records the times of a cycle, unless a reader holds the figures.
    pub fn record_cycle(&self, record: impl FnOnce(&mut LoopFigures)) {
        if let Ok(mut figures) = self.figures.try_lock() {
            record(&mut figures);
        }
    }

    /// Locks the figures.
    pub fn figures(&self) -> MutexGuard<'_, LoopFigures> {
        lock(&self.figures)
    }

    /// Locks the reason why there is no connection, or why the robot takes no motion.
    pub fn problem(&self) -> MutexGuard<'_, String> {
        lock(&self.problem)
    }

    /// Locks the reason of the last motion that ended by itself.
    pub fn ended(&self) -> MutexGuard<'_, Option<End>> {
        lock(&self.ended)
    }

    /// Returns the connected robot.
    pub fn robot(&self) -> Option<Arc<Robot>> {
        lock(&self.robot).clone()
    }

    /// Records a new connection.
    pub fn connected(&self, robot: &Arc<Robot>, hang_up: Option<HangUp>) {
        self.configured.store(false, Ordering::Relaxed);
        self.server_version.store(robot.server_version(), Ordering::Relaxed);
        *lock(&self.robot) = Some(Arc::clone(robot));
        *lock(&self.hang_up) = hang_up;
        self.problem().clear();
    }

    /// Records that the connection was lost, or could not be made.
    pub fn disconnected(&self, why: String) {
        *self.problem() = why;
        self.configured.store(false, Ordering::Relaxed);
        *lock(&self.robot) = None;
        *lock(&self.hang_up) = None;
        *self.measured() = None;
        self.stop_following();
    }

    /// Ends the order to follow. The next motion begins where the arm is then.
    pub fn stop_following(&self) {
        let mut orders = self.orders();
        (orders.follow, orders.target) = (false, None);
    }

    /// Ends the connection from outside of the thread that hangs on it. Returns false if the system does not allow it.
    pub fn hang_up(&self) -> bool {
        let connecting = || lock(&self.address).and_then(HangUp::find);
        match lock(&self.hang_up).as_ref() {
            Some(connected) => connected.end(),
            None => connecting().is_some_and(|socket| socket.end()),
        }
    }

    /// Records the address that a connection is being made to.
    pub fn connecting(&self, address: Option<SocketAddr>) {
        *lock(&self.address) = address;
    }

    /// Records the start or the end of a call that waits for the robot's answer.
    pub fn asking(&self, since: Option<Instant>) {
        *lock(&self.asking_since) = since;
    }

    /// Returns the start of the running call that waits for the robot's answer.
    pub fn asks_since(&self) -> Option<Instant> {
        *lock(&self.asking_since)
    }

    /// Returns true if a connection stands.
    pub fn is_connected(&self) -> bool {
        lock(&self.robot).is_some()
    }
}
