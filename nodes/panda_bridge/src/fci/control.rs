//! Control thread: connects, reads states, and drives the arm by torques while a motion runs.

use super::cycle::{Cycle, Step};
use super::explain::explain;
use super::hangup::HangUp;
use super::settings::{FciSettings, Generation};
use super::shared::{Phase, Shared};
use franka::realtime::set_current_thread_scheduler_priority;
use franka::{
    FciVersion, FrankaError, FrankaResult, RealtimeConfig, Robot, RobotMode, RobotOptions, Torques, VersionPolicy,
};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time between two attempts to connect.
const AGAIN: Duration = Duration::from_secs(1);
/// Port of FCI, if the host names none.
const PORT: u16 = 1337;

/// Connects, and connects again after a failure, until the link ends.
pub fn run(shared: &Shared, settings: &FciSettings) {
    let mut last = String::new();
    while !shared.ending.load(Ordering::Relaxed) {
        let why = match connect(shared, settings) {
            Ok(robot) => {
                last.clear();
                match serve(shared, settings, &robot) {
                    Ok(()) => return,
                    Err(error) => explain(&error),
                }
            }
            Err(error) => explain(&error),
        };
        // At the end of a graph, the arm may go before this node.
        if shared.ending.load(Ordering::Relaxed) {
            return;
        }
        // The same failure is repeated every second until the robot answers.
        if why != last {
            tracing::error!("{}: {why}", settings.host);
            last.clone_from(&why);
        }
        shared.disconnected(why);
        let start = Instant::now();
        while start.elapsed() < AGAIN && !shared.ending.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

fn connect(shared: &Shared, settings: &FciSettings) -> FrankaResult<Arc<Robot>> {
    let version = match settings.generation {
        Generation::Panda => FciVersion::V5,
        Generation::Fr3 => FciVersion::V10,
    };
    let options = RobotOptions::new(RealtimeConfig::Ignore).with_version(VersionPolicy::Exact(version));
    let robot = Arc::new(Robot::with_options(&settings.host, options)?);
    // The client library has already tried for the highest priority, which leaves none for the kernel's own threads.
    match set_current_thread_scheduler_priority(settings.priority) {
        Ok(()) => tracing::info!("control thread: real-time priority {}", settings.priority),
        Err(why) => tracing::warn!("control thread without real-time priority, cycles may be lost: {why}"),
    }
    tracing::info!("{}: connected; the robot speaks FCI version {}", settings.host, robot.server_version());
    let port = settings.host.rsplit_once(':').and_then(|(_, port)| port.parse().ok()).unwrap_or(PORT);
    shared.connected(&robot, HangUp::find(port));
    Ok(robot)
}

/// Serves a connection until it is lost, or until the link ends.
fn serve(shared: &Shared, settings: &FciSettings, robot: &Robot) -> FrankaResult<()> {
    let model = robot.load_model()?;
    while !shared.ending.load(Ordering::Relaxed) {
        let state = robot.read_once()?;
        shared.record(&state, Phase::Monitoring);
        if state.robot_mode != RobotMode::Idle || !shared.orders().follow {
            continue;
        }
        match follow(shared, robot, Cycle::new(settings, &model)) {
            Ok(()) => {}
            Err(error @ FrankaError::Network(_)) => return Err(error),
            Err(error) => {
                let names = match &error {
                    FrankaError::Control(exception) => exception.last_motion_errors.names().join(", "),
                    _ => String::new(),
                };
                let why = if names.is_empty() { explain(&error) } else { names };
                tracing::error!("motion ended by the robot: {why}");
                *shared.ended() = Some(why);
                shared.orders().follow = false;
            }
        }
    }
    Ok(())
}

/// Runs a motion until it is no longer wanted and the arm is at rest.
fn follow(shared: &Shared, robot: &Robot, mut cycle: Cycle<'_>) -> FrankaResult<()> {
    let mut control = robot.start_torque_control()?;
    let mut orders = *shared.orders();
    loop {
        let (state, period) = control.read_once()?;
        let begun = Instant::now();
        shared.read_orders(&mut orders);
        let wanted =
            orders.follow && orders.refreshed.elapsed() < cycle.patience() && !shared.ending.load(Ordering::Relaxed);
        let step = cycle.step(&state, &orders, wanted);
        let computing = begun.elapsed();
        let (torques, finished) = match step {
            Step::Go(torques) => (torques, false),
            Step::Finish(torques) => (torques, true),
        };
        shared.record(&state, if wanted { Phase::Following } else { Phase::Stopping });
        if finished {
            return control.write_once(&franka::motion_finished(Torques::new(torques)));
        }
        control.write_once(&Torques::new(torques))?;
        shared.record_cycle(|figures| figures.add(computing, period.as_millis()));
    }
}
