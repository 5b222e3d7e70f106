//! Tests of the direct transport against the emulated arm, in lock step. A failure here means an arm that moves otherwise than it was
//! told, or that stands without a reason given.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use nalgebra::{Isometry3, Translation3, Vector3};
use panda_bridge::fci::{End, FciLink, FciSettings, Generation, Phase, isometry};
use panda_emulator::Settings;
use panda_emulator::fci::Generation as Emulated;
use panda_emulator::server::{Pace, Server, ServerOptions};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(20);

/// Emulated arm at a loopback address of its own, and a link to it.
struct Cell {
    server: Server,
    link: FciLink,
}

fn address() -> SocketAddr {
    static NEXT: AtomicU8 = AtomicU8::new(1);
    // The process number keeps tests apart that run at once; the port is that of FCI, which clients do not choose.
    let process = (std::process::id() % 250 + 1) as u8;
    SocketAddr::from(([127, 61, process, NEXT.fetch_add(1, Ordering::Relaxed)], 1337))
}

fn start(settings: FciSettings) -> std::io::Result<FciLink> {
    FciLink::start(settings, || panic!("the connection cannot be ended"))
}

fn serve(address: SocketAddr, settings: Settings) -> Server {
    let options = ServerOptions { settings, pace: Pace::LockStep, ..ServerOptions::default() };
    Server::bind(address, options).unwrap()
}

fn settings(address: SocketAddr) -> FciSettings {
    FciSettings { priority: 1, ..FciSettings::new(&address.ip().to_string(), Generation::Panda) }
}

impl Cell {
    fn start(arm: Settings) -> Self {
        let address = address();
        let generation = if arm.generation == Emulated::Fr3 { Generation::Fr3 } else { Generation::Panda };
        let server = serve(address, arm);
        let link = start(FciSettings { generation, ..settings(address) }).unwrap();
        let cell = Self { server, link };
        cell.wait("a link that is ready", |link| link.unready().is_none());
        cell
    }

    /// Waits, and keeps the order to follow or not alive meanwhile.
    fn wait(&self, what: &str, holds: impl FnMut(&FciLink) -> bool) {
        wait_for(&self.link, what, holds);
    }

    /// Lets the arm follow a target at this distance in x until `cycles` of the robot have passed.
    fn follow(&self, target: Isometry3<f64>, cycles: u64) {
        self.link.set_target(target);
        self.link.follow(true);
        let from = self.server.handle().snapshot().message_id;
        self.wait("the end of the motion", |link| {
            link.follow(true);
            self.server.handle().snapshot().message_id > from + cycles
        });
    }

    fn pose(&self) -> Isometry3<f64> {
        isometry(&self.link.measured().unwrap().state.O_T_EE)
    }

    fn phase(&self) -> Option<Phase> {
        self.link.measured().map(|m| m.phase)
    }
}

fn wait_for(link: &FciLink, what: &str, mut holds: impl FnMut(&FciLink) -> bool) {
    let start = Instant::now();
    while !holds(link) {
        assert!(start.elapsed() < SOON, "{what} within {SOON:?}: {:?}, {:?}", link.unready(), link.measured());
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn moved(pose: &Isometry3<f64>, x_m: f64) -> Isometry3<f64> {
    Translation3::new(x_m, 0.0, 0.0) * pose
}

#[test]
fn the_hand_goes_to_its_target_and_comes_to_rest_before_the_end() {
    goes_and_rests(Settings::default());
}

#[test]
fn the_hand_of_an_fr3_does_too() {
    goes_and_rests(Settings::of(Emulated::Fr3));
}

fn goes_and_rests(arm: Settings) {
    let cell = Cell::start(arm);
    let start = cell.pose();
    cell.follow(moved(&start, 0.06), 3000);
    let error: Vector3<f64> = cell.pose().translation.vector - moved(&start, 0.06).translation.vector;
    assert!(error.norm() < 0.003, "{error}");
    // Ending a motion while the arm moves would be error 14 of the robot.
    cell.follow(moved(&start, 0.0), 150);
    cell.link.follow(false);
    cell.wait("the end", |link| link.measured().is_some_and(|m| m.phase == Phase::Monitoring));
    assert_eq!(cell.link.take_end(), None);
    assert_eq!(cell.link.figures().lost_states, 0);
}

#[test]
fn a_push_beyond_the_threshold_is_a_reflex_by_name_until_it_is_recovered_from() {
    let cell = Cell::start(Settings::default());
    let start = cell.pose();
    cell.follow(start, 200);
    cell.server.handle().push([60.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mut end = None;
    cell.wait("the reflex", |link| {
        end = end.take().or_else(|| link.take_end());
        end.is_some()
    });
    let Some(End::Fault(names)) = &end else { panic!("{end:?}") };
    assert!(names.contains("reflex"), "{names}");
    cell.server.handle().push([0.0; 6]);
    cell.link.recover().unwrap();
    let here = cell.pose();
    cell.follow(moved(&here, 0.02), 1500);
    assert!((cell.pose().translation.x - here.translation.x - 0.02).abs() < 0.003);
}

#[test]
fn the_user_stop_ends_the_motion_and_is_no_reflex() {
    let cell = Cell::start(Settings::default());
    cell.follow(cell.pose(), 200);
    cell.server.handle().set_user_stop(true);
    cell.wait("the user stop", |link| {
        link.measured().is_some_and(|m| format!("{:?}", m.state.robot_mode) == "UserStopped")
    });
    let mut end = None;
    cell.wait("the end of the motion", |link| {
        end = end.take().or_else(|| link.take_end());
        end.is_some()
    });
    assert_eq!(end, Some(End::UserStop));
    cell.server.handle().set_user_stop(false);
    cell.wait("the release", |link| {
        link.measured().is_some_and(|m| format!("{:?}", m.state.robot_mode) != "UserStopped")
    });
    cell.link.recover().unwrap();
}

#[test]
fn a_silent_caller_brings_the_arm_to_rest() {
    let cell = Cell::start(Settings::default());
    cell.follow(moved(&cell.pose(), 0.05), 100);
    std::thread::sleep(Duration::from_millis(200));
    cell.wait("the end", |_| cell.phase() == Some(Phase::Monitoring));
    assert_eq!(cell.link.take_end(), None);
}

#[test]
fn closed_brakes_are_named() {
    let address = address();
    let server = serve(address, Settings::default());
    server.handle().set_brakes(false);
    let link = start(settings(address)).unwrap();
    wait_for(&link, "a state", |link| link.measured().is_some());
    assert!(link.unready().unwrap().contains("open them in Desk"));
    server.handle().set_brakes(true);
    wait_for(&link, "readiness", |link| link.unready().is_none());
}

#[test]
fn a_host_without_robot_and_a_robot_of_another_version_are_named() {
    let nobody = start(settings(address())).unwrap();
    wait_for(&nobody, "a refusal", |link| link.unready().unwrap().contains("activate FCI in Desk"));
    let address = address();
    let _server = serve(address, Settings::default());
    let other = FciSettings { generation: Generation::Fr3, ..settings(address) };
    let link = start(other).unwrap();
    wait_for(&link, "the version", |link| link.unready().unwrap().contains("FCI version 5"));
}

#[test]
fn a_second_client_is_told_that_the_robot_has_one() {
    let cell = Cell::start(Settings::default());
    let address = cell.server.address();
    let second = start(settings(address)).unwrap();
    let first = |link: &FciLink| link.unready().filter(|why| !why.starts_with("not connected"));
    wait_for(&second, "a refusal", |link| first(link).is_some());
    let why = first(&second).unwrap();
    assert!(why.contains("another client"), "{why}");
    cell.follow(cell.pose(), 100);
}

#[test]
fn a_robot_that_restarts_is_met_again_and_the_arm_does_not_move_by_itself() {
    let address = address();
    let server = serve(address, Settings::default());
    let link = start(settings(address)).unwrap();
    wait_for(&link, "readiness", |link| link.unready().is_none());
    link.follow(true);
    drop(server);
    wait_for(&link, "the loss", |link| link.measured().is_none());
    let server = serve(address, Settings::default());
    wait_for(&link, "readiness", |link| link.unready().is_none());
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(link.measured().unwrap().phase, Phase::Monitoring, "an arm that was lost is not followed by itself");
    drop(server);
}

#[test]
fn a_hold_brakes_the_arm_where_it_is() {
    let cell = Cell::start(Settings::default());
    let start = cell.pose();
    // On its way, the filtered target leads the arm.
    cell.follow(moved(&start, 0.08), 150);
    cell.link.hold();
    let at = cell.pose();
    let from = cell.server.handle().snapshot().message_id;
    let mut farthest = 0.0_f64;
    cell.wait("the rest", |link| {
        link.follow(true);
        farthest = farthest.max(cell.pose().translation.x - at.translation.x);
        cell.server.handle().snapshot().message_id > from + 1000
    });
    assert!(farthest < 0.012, "{farthest} m beyond the place of the hold");
}

#[test]
fn a_server_that_never_answers_is_given_up() {
    let address = address();
    let listener = std::net::TcpListener::bind(address).unwrap();
    let link = start(settings(address)).unwrap();
    // The kernel accepts for the listener, and nobody answers.
    let start = Instant::now();
    while !link.unready().unwrap().contains("closed the connection") {
        assert!(start.elapsed() < SOON, "{:?}", link.unready());
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(listener);
}

#[test]
fn a_joint_near_its_limit_is_named_before_a_motion() {
    let mut arm = Settings::default();
    arm.start_joints_rad[3] = -3.05;
    let address = address();
    let _server = serve(address, arm);
    let link = start(settings(address)).unwrap();
    wait_for(&link, "the joint", |link| link.unready().unwrap_or_default().contains("joint 4 is 0.0"));
}

#[test]
fn a_robot_that_was_stopped_at_the_connection_can_move_when_its_recovery_has_answered() {
    for _ in 0..3 {
        let address = address();
        let server = serve(address, Settings::default());
        server.handle().set_user_stop(true);
        let link = start(settings(address)).unwrap();
        let mode = |link: &FciLink| link.measured().map(|m| format!("{:?}", m.state.robot_mode)).unwrap_or_default();
        wait_for(&link, "the user stop", |link| mode(link) == "UserStopped");
        server.handle().set_user_stop(false);
        wait_for(&link, "the release", |link| mode(link) != "UserStopped");
        link.recover().unwrap();
        assert_eq!((mode(&link).as_str(), link.unready()), ("Idle", None));
    }
}
