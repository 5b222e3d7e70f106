//! Control thread: connects, reads states, and drives the arm by torques while a motion runs.

use super::cycle::{self, Cycle, Step};
use super::explain::explain;
use super::hangup::HangUp;
use super::plausible::StateCheck;
use super::realtime::{self, PRIORITY_REMEDY};
use super::settings::{FciSettings, Generation};
use super::shared::{End, Orders, Phase, Shared};
use super::state_socket::hear_robot_alone;
use franka::{
    FciVersion, FrankaError, FrankaResult, MoveStatus, RealtimeConfig, Robot, RobotMode, RobotOptions, Torques,
    VersionPolicy,
};
use std::net::{SocketAddr, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time between two attempts to connect.
const AGAIN: Duration = Duration::from_secs(1);
/// Port of FCI, if the host names none.
const PORT: u16 = 1337;

/// Connects, and connects again after a failure, until the link ends.
pub fn run(shared: &Shared, settings: &FciSettings) {
    realtime::prepare_thread(settings.cpu);
    let mut last = String::new();
    let mut priority = None;
    while !shared.ending.load(Ordering::Relaxed) {
        let why = match connect(shared, settings, &mut priority) {
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
        // A failure comes again every second until the robot answers; its first time is logged.
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

/// Returns the address of the robot; `None` if the name is not known. States come by IPv4 alone.
fn address_of(host: &str) -> Option<SocketAddr> {
    let with_port = if host.rsplit_once(':').is_some() { host.to_owned() } else { format!("{host}:{PORT}") };
    let all: Vec<SocketAddr> = with_port.to_socket_addrs().ok()?.collect();
    all.iter().find(|address| address.is_ipv4()).or(all.first()).copied()
}

/// Connects. `priority` is the last answer to the wish for a real-time priority, which is logged when it changes.
fn connect(
    shared: &Shared,
    settings: &FciSettings,
    priority: &mut Option<Result<(), String>>,
) -> FrankaResult<Arc<Robot>> {
    let address = address_of(&settings.host);
    shared.connecting(address);
    // The library waits without a timeout for the answer to its first request.
    shared.asking(Some(Instant::now()));
    let connected = open(settings, address);
    shared.asking(None);
    // The client library has already tried for the highest priority, which leaves none for the kernel's own threads.
    let granted = realtime::set_priority(settings.priority);
    if priority.as_ref() != Some(&granted) {
        match &granted {
            Ok(()) => tracing::info!("control thread: real-time priority {}", settings.priority),
            Err(why) => tracing::warn!(
                "control thread without real-time priority, cycles may be lost ({why}): {PRIORITY_REMEDY}"
            ),
        }
        *priority = Some(granted);
    }
    let robot = connected?;
    shared.connected(&robot, address.and_then(HangUp::find));
    Ok(robot)
}

fn open(settings: &FciSettings, address: Option<SocketAddr>) -> FrankaResult<Arc<Robot>> {
    let version = match settings.generation {
        Generation::Panda => FciVersion::V5,
        Generation::Fr3 => FciVersion::V10,
    };
    let options = RobotOptions::new(RealtimeConfig::Ignore).with_version(VersionPolicy::Exact(version));
    // A name may have several addresses: the library gets the one whose states are listened to.
    let host = address.map_or_else(|| settings.host.clone(), |address| address.to_string());
    let robot = Arc::new(Robot::with_options(&host, options)?);
    // Without the address nobody could tell the robot's states from others.
    let address = address.ok_or_else(|| FrankaError::Network(format!("fci.host: {} is not known", settings.host)))?;
    hear_robot_alone(&robot, address).map_err(FrankaError::Network)?;
    tracing::info!("{}: connected; the robot speaks FCI version {}", settings.host, robot.server_version());
    Ok(robot)
}

/// Serves a connection until it is lost, or until the link ends.
fn serve(shared: &Shared, settings: &FciSettings, robot: &Robot) -> FrankaResult<()> {
    let model = robot.load_model()?;
    let mut check = StateCheck::new();
    while !shared.ending.load(Ordering::Relaxed) {
        let state = robot.read_once()?;
        check.check(&state, Instant::now())?;
        shared.record(&state, Phase::Monitoring);
        if matches!(state.robot_mode, RobotMode::Guiding | RobotMode::Other) {
            // A person who guides the arm, or moves it by Desk, chooses its posture.
            shared.orders().posture = None;
        }
        let mut orders = *shared.orders();
        if state.robot_mode != RobotMode::Idle || !may_begin(shared, &orders) {
            continue;
        }
        orders.posture = Some(cycle::posture_at_begin(orders.posture, &model, &state));
        shared.orders().posture.clone_from(&orders.posture);
        match follow(shared, robot, &mut check, Cycle::new(settings, &model, &orders), orders) {
            Ok(()) => {}
            Err(error @ FrankaError::Network(_)) => return Err(error),
            Err(error) => {
                let end = end_of(&error);
                tracing::error!("motion ended by the robot: {end:?}");
                *shared.ended() = Some(end);
                shared.stop_following();
            }
        }
    }
    Ok(())
}

/// Returns true if a motion may begin: the node asks for one now, has taken the end of the last one, and the robot has its thresholds.
fn may_begin(shared: &Shared, orders: &Orders) -> bool {
    orders.follow
        && orders.refreshed.elapsed() < Cycle::PATIENCE
        && shared.configured.load(Ordering::Relaxed)
        && shared.ended().is_none()
}

fn end_of(error: &FrankaError) -> End {
    let FrankaError::Control(exception) = error else { return End::Fault(explain(error)) };
    match exception.move_status {
        Some(MoveStatus::EmergencyAborted) => End::UserStop,
        // For another end, the names would be those of an earlier motion.
        Some(MoveStatus::ReflexAborted) if exception.last_motion_errors.any() => {
            End::Fault(exception.last_motion_errors.names().join(", "))
        }
        _ => End::Fault(explain(error)),
    }
}

/// Runs a motion until it is no longer wanted and the arm is at rest.
fn follow(
    shared: &Shared,
    robot: &Robot,
    check: &mut StateCheck,
    mut cycle: Cycle<'_>,
    mut orders: Orders,
) -> FrankaResult<()> {
    let mut control = robot.start_torque_control()?;
    loop {
        let (state, period) = control.read_once()?;
        let begun = Instant::now();
        check.check(&state, begun)?;
        shared.read_orders(&mut orders);
        let wanted =
            orders.follow && orders.refreshed.elapsed() < Cycle::PATIENCE && !shared.ending.load(Ordering::Relaxed);
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
