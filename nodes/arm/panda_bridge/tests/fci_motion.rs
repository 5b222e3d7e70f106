//! Posture and speed of the arm, against the emulated arm in lock step. A failure here means an elbow that creeps away from its place,
//! motion by motion, while the hand always comes back, or a hand that is faster than its user allows.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use nalgebra::{Isometry3, SVector, Translation3};
use panda_bridge::fci::{Collision, FciLink, FciSettings, Generation, Phase, isometry};
use panda_bridge::law::LawSettings;
use panda_bridge::{Compliance, SpeedLimit, kinematics};
use panda_emulator::Settings;
use panda_emulator::server::{Pace, Server, ServerOptions};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

type Joints = SVector<f64, 7>;

/// Time without progress after which a wait fails.
const SOON: Duration = Duration::from_secs(60);
/// Motions of the test.
const MOVES: u32 = 200;
/// Cycles that a motion follows its target, ms.
const FOLLOWED: u64 = 900;

struct Cell {
    server: Server,
    link: FciLink,
}

impl Cell {
    fn start(last: u8, change: impl FnOnce(FciSettings) -> FciSettings) -> Self {
        let process = (std::process::id() % 250 + 1) as u8;
        let address = SocketAddr::from(([127, 62, process, last], 1337));
        let options = ServerOptions { settings: Settings::default(), pace: Pace::LockStep, ..ServerOptions::default() };
        let server = Server::bind(address, options).unwrap();
        let settings = FciSettings { priority: 1, ..FciSettings::new(&address.ip().to_string(), Generation::Panda) };
        let link = FciLink::start(change(settings), || panic!("the connection cannot be ended")).unwrap();
        let cell = Self { server, link };
        cell.wait("a link that is ready", || cell.link.unready().is_none());
        cell
    }

    fn wait(&self, what: &str, mut holds: impl FnMut() -> bool) {
        let start = Instant::now();
        while !holds() {
            assert!(start.elapsed() < SOON, "{what}: {:?}", self.link.unready());
            assert_eq!(self.link.take_end(), None, "{what}");
            std::thread::sleep(Duration::from_micros(300));
        }
    }

    fn joints(&self) -> Joints {
        self.link.measured().unwrap().state.q.into()
    }

    fn pose(&self) -> Isometry3<f64> {
        isometry(&self.link.measured().unwrap().state.O_T_EE)
    }

    /// Moves the hand to a target in a motion of its own, and ends the motion at rest.
    fn go(&self, target: &Isometry3<f64>) {
        let from = self.server.handle().snapshot().message_id;
        self.link.set_target(*target);
        self.wait("the motion", || {
            self.link.follow(true);
            let is_following = self.link.measured().is_some_and(|m| m.phase == Phase::Following);
            is_following && self.server.handle().snapshot().message_id > from + FOLLOWED
        });
        self.link.follow(false);
        self.wait("the end of the motion", || self.link.measured().is_some_and(|m| m.phase == Phase::Monitoring));
    }
}

#[test]
fn two_hundred_motions_leave_the_elbow_where_it_was() {
    let cell = Cell::start(1, |settings| settings);
    let home = cell.pose();
    cell.go(&home);
    let first = cell.joints();
    // Round and round in one sense: a loop of the hand that is followed without a posture turns the elbow by the same angle each time.
    let corners = [[0.0, 0.08, 0.0], [0.0, 0.08, -0.08], [0.0, -0.08, -0.08], [0.0, 0.0, 0.0]];
    let mut worst_rad = 0.0_f64;
    for number in 1..=MOVES {
        let [x, y, z] = corners[(number as usize - 1) % corners.len()];
        cell.go(&(Translation3::new(x, y, z) * home));
        if (number as usize).is_multiple_of(corners.len()) {
            let (off, hand) = (cell.joints() - first, cell.pose().translation.vector - home.translation.vector);
            worst_rad = worst_rad.max(off.amax());
            if number.is_multiple_of(20) {
                let mrad: Vec<String> = off.iter().map(|v| format!("{:+.1}", 1e3 * v)).collect();
                println!(
                    "{number} motions: joints off by {} mrad, hand by {:.2} mm",
                    mrad.join(" "),
                    1e3 * hand.norm()
                );
            }
        }
    }
    println!("greatest difference of a joint: {:.1} mrad", 1e3 * worst_rad);
    assert!(worst_rad < 0.02, "{worst_rad} rad");
}

#[test]
fn an_elbow_that_was_moved_returns_to_its_posture_and_the_hand_stays() {
    let cell = Cell::start(2, |settings| settings);
    let home = cell.pose();
    cell.go(&home);
    let first = cell.joints();
    let place = panda_bridge::ArmPose::from_parts(home.translation.vector.into(), &home.rotation);
    // Joint 1 half a radian further with the hand at its place: inverse kinematics change the other joints, too.
    let mut aside: [f64; 7] = first.into();
    (aside[0], aside[2]) = (aside[0] + 0.5, aside[2] - 0.5);
    let aside = Joints::from(kinematics::inverse(&place, &aside).unwrap());
    assert!((aside - first).amax() > 0.3, "{aside}");
    for posture in [aside, first] {
        cell.link.set_target(home);
        cell.wait("the motion", || {
            cell.link.follow(true);
            cell.link.measured().is_some_and(|m| m.phase == Phase::Following)
        });
        cell.link.set_posture(posture);
        // By 0.5 rad/s: four seconds are enough.
        let from = cell.server.handle().snapshot().message_id;
        cell.wait("the elbow", || {
            cell.link.follow(true);
            cell.server.handle().snapshot().message_id > from + 4000
        });
        cell.go(&home);
        let (off, hand) =
            ((cell.joints() - posture).amax(), (cell.pose().translation.vector - home.translation.vector).norm());
        println!("joints off by at most {:.1} mrad, hand by {:.2} mm", 1e3 * off, 1e3 * hand);
        assert!(off < 0.05 && hand < 0.004, "{off} rad, {hand} m");
    }
}

/// Greatest speed of the hand on its way to a target 0.22 m away, m/s, with the hardest gains and the least damping that are allowed: 80 N
/// on a hand of a few kilograms.
fn greatest_speed_m_s(last: u8, speed: SpeedLimit) -> f64 {
    let compliance = Compliance {
        stiffness: [3000.0, 3000.0, 3000.0, 150.0, 150.0, 150.0],
        damping: [28.0, 28.0, 28.0, 7.0, 7.0, 7.0],
        error_clip_m: 0.0266,
    };
    compliance.check().unwrap();
    let collision = Collision { torque_n_m: [300.0; 7], wrench: [300.0; 6] };
    let law = LawSettings { speed, ..LawSettings::default() };
    let cell = Cell::start(last, |settings| FciSettings { compliance, collision, law, ..settings });
    let target = Translation3::new(0.2, 0.0, -0.1) * cell.pose();
    let from = cell.server.handle().snapshot().message_id;
    cell.link.set_target(target);
    let mut fastest_m_s = 0.0_f64;
    cell.wait("the motion", || {
        cell.link.follow(true);
        let state = cell.link.measured().unwrap().state;
        let twist = kinematics::jacobian(&state.q) * Joints::from(state.dq);
        fastest_m_s = fastest_m_s.max(twist.fixed_rows::<3>(0).norm());
        cell.server.handle().snapshot().message_id > from + 3000
    });
    assert!((cell.pose().translation.vector - target.translation.vector).norm() < 0.01, "it arrives");
    fastest_m_s
}

#[test]
fn the_hand_keeps_to_its_speed_limit_with_the_hardest_gains_and_little_damping() {
    let limited = greatest_speed_m_s(3, SpeedLimit { linear_m_s: 0.3, angular_rad_s: 1.0 });
    let free = greatest_speed_m_s(4, SpeedLimit::NONE);
    println!("greatest speed of the hand: {limited:.3} m/s with a limit of 0.3 m/s, {free:.3} m/s without");
    assert!(limited > 0.2 && limited < 0.33, "{limited} m/s");
    assert!(free > 2.0 * limited, "the gains reach {free} m/s: the limit has something to do");
}
