//! Tests of the direct transport against the emulated arm, in lock step. A failure here means an arm that moves otherwise than it was
//! told, or that stands without a reason given.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use nalgebra::{Isometry3, Translation3, Vector3};
use panda_bridge::Compliance;
use panda_bridge::fci::{Collision, FciLink, FciSettings, Generation, Load, Phase, isometry};
use panda_bridge::law::LawSettings;
use panda_emulator::Settings;
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

fn serve(address: SocketAddr, settings: Settings) -> Server {
    let options = ServerOptions { settings, pace: Pace::LockStep, ..ServerOptions::default() };
    Server::bind(address, options).unwrap()
}

fn settings(address: SocketAddr) -> FciSettings {
    FciSettings {
        host: address.ip().to_string(),
        generation: Generation::Panda,
        priority: 1,
        cutoff_hz: 100.0,
        law: LawSettings::default(),
        compliance: Compliance::default(),
        collision: Collision::default(),
        load: Load::default(),
    }
}

impl Cell {
    fn start(arm: Settings) -> Self {
        let address = address();
        let server = serve(address, arm);
        let link = FciLink::start(settings(address)).unwrap();
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
    let cell = Cell::start(Settings::default());
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
    assert!(end.as_ref().unwrap().contains("reflex"), "{end:?}");
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
    assert!(end.unwrap().contains("User Stop"));
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
    let link = FciLink::start(settings(address)).unwrap();
    wait_for(&link, "a state", |link| link.measured().is_some());
    assert!(link.unready().unwrap().contains("open them in Desk"));
    server.handle().set_brakes(true);
    wait_for(&link, "readiness", |link| link.unready().is_none());
}

#[test]
fn a_host_without_robot_and_a_robot_of_another_version_are_named() {
    let nobody = FciLink::start(settings(address())).unwrap();
    wait_for(&nobody, "a refusal", |link| link.unready().unwrap().contains("activate FCI in Desk"));
    let address = address();
    let _server = serve(address, Settings::default());
    let other = FciSettings { generation: Generation::Fr3, ..settings(address) };
    let link = FciLink::start(other).unwrap();
    wait_for(&link, "the version", |link| link.unready().unwrap().contains("FCI version 5"));
}

#[test]
fn a_second_client_is_told_that_the_robot_has_one() {
    let cell = Cell::start(Settings::default());
    let address = cell.server.address();
    let second = FciLink::start(settings(address)).unwrap();
    wait_for(&second, "a refusal", |link| link.unready().unwrap().contains("another client"));
    cell.follow(cell.pose(), 100);
}

#[test]
fn a_robot_that_restarts_is_met_again_and_the_arm_does_not_move_by_itself() {
    let address = address();
    let server = serve(address, Settings::default());
    let link = FciLink::start(settings(address)).unwrap();
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
