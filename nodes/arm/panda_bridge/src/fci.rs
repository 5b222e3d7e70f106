//! Direct transport to the arm: the Franka Control Interface (FCI) at 1 kHz, by the client library franka-rs.
//!
//! Three threads share one connection. The control thread reads each state and answers it with torques; it allocates nothing while a
//! motion runs, and waits for no lock. The session thread makes the requests that wait for an answer: thresholds, load, recovery. The
//! watchdog ends a connection on which one of the two hangs, because franka-rs waits for answers without a timeout.
#![allow(
    clippy::disallowed_methods,
    reason = "the transport runs threads, and times them on a clock that does not step"
)]

mod control;
mod cycle;
mod explain;
mod figures;
mod hangup;
mod own_sockets;
mod plausible;
pub mod realtime;
mod session;
mod settings;
mod shared;
mod state_socket;
mod watchdog;

pub use cycle::isometry;
pub use figures::LoopFigures;
pub use settings::{Collision, DEFAULT_PRIORITY, FciSettings, Generation, Load};
pub use shared::{End, Measured, Phase};

use crate::compliance::Compliance;
use crate::kinematics;
use crate::law::{JointLimits, Joints};
use franka::{RobotMode, RobotState};
use nalgebra::Isometry3;
use shared::Shared;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Timeout of a request to the session thread. Chosen: a recovery takes about a second.
const ANSWER: Duration = Duration::from_secs(5);
/// Age of a state that no longer tells where the arm is. A recorded real arm paused for 8 ms at most.
const STALE: Duration = Duration::from_millis(200);
/// Time that the threads get to end. Chosen: the arm comes to rest within a second, and a read waits a second at most.
const ENDING: Duration = Duration::from_secs(4);

/// Connection to an arm. Dropping it brings the arm to rest and ends the connection.
pub struct FciLink {
    shared: Arc<Shared>,
    session: session::Caller,
    threads: Vec<JoinHandle<()>>,
    limits: JointLimits,
}

impl FciLink {
    /// Starts the threads of a connection. They connect, and connect again, until the link is dropped. `end_process` ends the process:
    /// it is called if a connection hangs and the system gives no other way to end it.
    ///
    /// # Errors
    /// A thread that the system refuses.
    pub fn start(settings: FciSettings, end_process: fn()) -> std::io::Result<Self> {
        realtime::lock_memory();
        let shared = Arc::new(Shared::new(settings.compliance));
        let (session, requests) = session::channel();
        let limits = settings.generation.limits();
        // Dropped, and its threads ended, if one of them cannot start.
        let mut link = Self { shared: Arc::clone(&shared), session, threads: Vec::new(), limits };
        let mut spawn = |name: &str, work: Box<dyn FnOnce() + Send>| -> std::io::Result<()> {
            link.threads.push(std::thread::Builder::new().name(name.to_owned()).spawn(work)?);
            Ok(())
        };
        // The control thread comes last: franka-rs makes it real-time, and threads inherit that from their parent.
        let (own, of) = (Arc::clone(&shared), settings.clone());
        spawn("fci session", Box::new(move || session::run(&own, &of, &requests)))?;
        let (own, priority) = (Arc::clone(&shared), settings.priority);
        spawn("fci watchdog", Box::new(move || watchdog::run(&own, priority, end_process)))?;
        spawn("fci control", Box::new(move || control::run(&shared, &settings)))?;
        Ok(link)
    }

    /// Returns the newest state of the robot; `None` without a connection, or if the last state is older than 0.2 s.
    #[must_use]
    pub fn measured(&self) -> Option<Measured> {
        self.shared.measured().filter(|m| m.at.elapsed() < STALE)
    }

    /// Returns the version of FCI that the robot's server speaks; 0 before the first connection.
    #[must_use]
    pub fn server_version(&self) -> u16 {
        self.shared.server_version.load(Ordering::Relaxed)
    }

    /// Returns the reason why the robot takes no motion now; `None` if it takes one. Latched stops are the gate's business.
    #[must_use]
    pub fn unready(&self) -> Option<String> {
        let problem = self.shared.problem().clone();
        if !problem.is_empty() {
            return Some(problem);
        }
        let Some(measured) = self.measured() else { return Some("no state came from the robot yet".to_owned()) };
        let state = &measured.state;
        let why = match state.robot_mode {
            RobotMode::Other => "the brakes are closed: open them in Desk",
            RobotMode::Guiding => "the arm is guided by hand: release the buttons of the hand",
            RobotMode::AutomaticErrorRecovery => "the robot is recovering: try again in a second",
            // The gate latches them and says what to do.
            RobotMode::UserStopped | RobotMode::Reflex => return None,
            _ if !self.is_configured(state) => {
                "the robot has not taken its end effector and its collision thresholds yet: try again in a second"
            }
            RobotMode::Idle => return self.pressed(state),
            _ => return None,
        };
        Some(why.to_owned())
    }

    fn is_configured(&self, state: &RobotState) -> bool {
        self.shared.configured.load(Ordering::Relaxed) && has_tool(state)
    }

    fn pressed(&self, state: &RobotState) -> Option<String> {
        let (joint, distance_rad) = self.limits.pressed(&state.q.into())?;
        Some(format!("joint {joint} is {distance_rad:.3} rad from its limit: guide the arm away from it by hand"))
    }

    /// Returns the reason of a motion that ended by itself since the last call.
    #[must_use]
    pub fn take_end(&self) -> Option<End> {
        self.shared.ended().take()
    }

    /// Returns the figures of the control loop.
    #[must_use]
    pub fn figures(&self) -> LoopFigures {
        self.shared.figures().clone()
    }

    /// Lets the arm follow its targets, or brings it to rest and ends the motion. Call it at least every 100 ms: the arm comes to
    /// rest if the caller is silent.
    pub fn follow(&self, on: bool) {
        let mut orders = self.shared.orders();
        // The next motion begins where the arm is then, not at the target of this one.
        if orders.follow && !on {
            orders.target = None;
        }
        orders.follow = on;
        orders.refreshed = Instant::now();
    }

    /// Makes this pose of the end effector the target. The law approaches it by its low-pass.
    pub fn set_target(&self, pose: Isometry3<f64>) {
        self.shared.orders().target = Some(pose);
    }

    /// Makes these joint angles (rad) the posture of this and of later motions. The hand keeps its target.
    pub fn set_posture(&self, joints_rad: Joints) {
        self.shared.orders().posture = Some(joints_rad);
    }

    /// Returns true if every joint is farther from its limits than the barriers' margin.
    #[must_use]
    pub fn is_clear_of_limits(&self, joints_rad: &Joints) -> bool {
        self.limits.pressed(joints_rad).is_none()
    }

    /// Brakes the arm where it is, and holds it there.
    pub fn hold(&self) {
        let mut orders = self.shared.orders();
        orders.target = None;
        orders.holds += 1;
    }

    /// Sets stiffness, damping and error clip, also during a motion.
    pub fn set_compliance(&self, compliance: Compliance) {
        self.shared.orders().compliance = compliance;
    }

    /// Asks the robot to recover from its errors, and waits until it is idle and has its settings, so that a motion can begin.
    ///
    /// # Errors
    /// The robot's refusal, a missing connection, or no answer in time.
    pub fn recover(&self) -> Result<(), String> {
        self.session.recover(ANSWER)?;
        // The answer overtakes the states: an older one would latch the reflex again.
        let start = Instant::now();
        while start.elapsed() < ANSWER {
            let Some(Measured { state, .. }) = self.measured() else {
                return Err("the connection was lost".to_owned());
            };
            // A robot that was stopped when the connection was made gets its settings only now.
            if state.robot_mode == RobotMode::Idle && self.is_configured(&state) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let why = self.unready().unwrap_or_else(|| "it is not idle: look at Desk".to_owned());
        Err(format!("the robot has answered, and cannot move yet: {why}"))
    }
}

/// Returns true if the end effector of the state is the hand's tool centre point.
fn has_tool(state: &RobotState) -> bool {
    let (has, wanted) = (isometry(&state.F_T_EE), kinematics::flange_from_tool());
    // The robot rounds to single precision.
    (has.translation.vector - wanted.translation.vector).norm() < 1e-4 && has.rotation.angle_to(&wanted.rotation) < 1e-3
}

/// Returns the pose of the hand's tool centre point in the base, whatever end effector Desk has set.
#[must_use]
pub fn tool_pose(state: &RobotState) -> Isometry3<f64> {
    isometry(&state.O_T_EE) * isometry(&state.F_T_EE).inverse() * kinematics::flange_from_tool()
}

impl Drop for FciLink {
    fn drop(&mut self) {
        self.shared.ending.store(true, Ordering::Relaxed);
        let start = Instant::now();
        for thread in self.threads.drain(..).rev() {
            while !thread.is_finished() && start.elapsed() < ENDING {
                std::thread::sleep(Duration::from_millis(5));
            }
            if thread.is_finished() {
                // A panic of the thread was reported when it happened.
                let _ = thread.join();
            } else {
                self.shared.hang_up();
            }
        }
    }
}
