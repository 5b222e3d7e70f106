//! Session thread: requests that wait for the robot's answer over TCP.

use super::explain::explain;
use super::settings::FciSettings;
use super::shared::Shared;
use crate::kinematics;
use franka::robot_state::IDENTITY_TRANSFORM;
use franka::{FrankaResult, Robot, RobotMode};
use nalgebra::Matrix4;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel as queue, sync_channel};
use std::time::{Duration, Instant};

/// Period in which an idle robot without thresholds is looked for.
const PERIOD: Duration = Duration::from_millis(50);

/// Request for a recovery.
pub struct Recovery {
    answer: SyncSender<Result<(), String>>,
    /// Time after which nobody waits for it any more: the robot must not recover then.
    until: Instant,
}

/// Sender of requests to the session thread.
pub struct Caller(Sender<Recovery>);

/// Makes the two ends of the queue to the session thread.
pub fn channel() -> (Caller, Receiver<Recovery>) {
    let (send, receive) = queue();
    (Caller(send), receive)
}

impl Caller {
    /// Asks for a recovery, and waits for its answer.
    ///
    /// # Errors
    /// The robot's refusal, or no answer in this time.
    pub fn recover(&self, timeout: Duration) -> Result<(), String> {
        let (answer, answered) = sync_channel(1);
        let until = Instant::now() + timeout;
        self.0.send(Recovery { answer, until }).map_err(|_| "the connection is ending".to_owned())?;
        answered
            .recv_timeout(timeout)
            .unwrap_or_else(|_| Err(format!("the robot has not answered within {} s", timeout.as_secs())))
    }
}

/// Serves requests until the link ends.
pub fn run(shared: &Shared, settings: &FciSettings, requests: &Receiver<Recovery>) {
    while !shared.ending.load(Ordering::Relaxed) {
        match requests.recv_timeout(PERIOD) {
            Ok(request) if Instant::now() < request.until => {
                // The asker may have given up.
                let _ = request.answer.send(ask(shared, Robot::automatic_error_recovery));
            }
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) => configure_idle(shared, settings),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Makes a request of the connected robot. The watchdog knows when it began.
fn ask(shared: &Shared, request: impl FnOnce(&Robot) -> FrankaResult<()>) -> Result<(), String> {
    let Some(robot) = shared.robot() else { return Err(shared.problem().clone()) };
    shared.asking(Some(Instant::now()));
    let done = request(&robot).map_err(|e| explain(&e));
    shared.asking(None);
    done
}

/// Sets frames, load and thresholds once in each connection. Robots refuse this while they move or have errors, so it waits for an
/// idle one.
fn configure_idle(shared: &Shared, settings: &FciSettings) {
    let Some(measured) = *shared.measured() else { return };
    if shared.configured.load(Ordering::Relaxed) || measured.state.robot_mode != RobotMode::Idle {
        return;
    }
    match ask(shared, |robot| configure(robot, settings, &measured.state.F_T_NE)) {
        Ok(()) => {
            shared.problem().clear();
            shared.configured.store(true, Ordering::Relaxed);
        }
        Err(why) => {
            let text = format!("the robot refuses its settings: {why}");
            let mut problem = shared.problem();
            if *problem != text {
                tracing::error!("{text}");
                *problem = text;
            }
        }
    }
}

fn configure(robot: &Robot, settings: &FciSettings, flange_from_nominal: &[f64; 16]) -> FrankaResult<()> {
    let (torque, wrench) = (settings.collision.torque_n_m, settings.collision.wrench);
    let contact = (torque.map(|v| 0.5 * v), wrench.map(|v| 0.5 * v));
    robot.set_collision_behavior_simple(contact.0, torque, contact.1, wrench)?;
    // The end effector of every message is panda_hand_tcp, whatever Desk has set.
    let nominal = Matrix4::from_column_slice(flange_from_nominal);
    let tool = kinematics::flange_from_tool().to_homogeneous();
    let nominal_from_tool = nominal.try_inverse().map_or(tool, |inverse| inverse * tool);
    robot.set_ee(std::array::from_fn(|i| nominal_from_tool[i]))?;
    robot.set_k(IDENTITY_TRANSFORM)?;
    let load = settings.load;
    let [x, y, z] = load.inertia_kg_m2;
    robot.set_load(load.mass_kg, load.centre_m, [x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z])
}
