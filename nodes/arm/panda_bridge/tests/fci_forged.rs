//! Datagrams of strangers at the port for the robot's states. A failure here means an arm that stops, or torques that leave, because
//! another program sent something.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "a test of threads and sockets waits for them, and a failure is a panic"
)]

use panda_bridge::fci::{FciLink, FciSettings, Generation, Phase};
use panda_emulator::fci::{ControllerMode, Generation as Emulated, Generator, RobotMode, RobotState};
use panda_emulator::server::{Pace, Server, ServerOptions};
use panda_emulator::wire::{HEADER_BYTES, STATE_BYTES_MAX, encode_connect, encode_state};
use panda_emulator::{Panda, Settings};
use std::io::{Read, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

const SOON: Duration = Duration::from_secs(30);
/// States of the running motion that a test waits for.
const CYCLES: u64 = 300;

fn address() -> SocketAddr {
    static NEXT: AtomicU8 = AtomicU8::new(1);
    let process = (std::process::id() % 250 + 1) as u8;
    SocketAddr::from(([127, 63, process, NEXT.fetch_add(1, Ordering::Relaxed)], 1337))
}

fn connect(address: SocketAddr) -> FciLink {
    let settings = FciSettings { priority: 1, ..FciSettings::new(&address.ip().to_string(), Generation::Panda) };
    FciLink::start(settings, || panic!("the connection cannot be ended")).unwrap()
}

fn wait_for(link: &FciLink, what: &str, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        let state = link.measured().map(|m| (m.phase, m.state.time));
        assert!(start.elapsed() < SOON, "{what}: {:?}, {state:?}, {:?}", link.unready(), link.take_end());
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Emulated arm in a motion, and strangers that send to the bridge's port.
struct Attacked {
    server: Server,
    link: FciLink,
    /// Strangers at another address, and at the robot's own address with another port.
    strangers: [UdpSocket; 2],
    /// Address of the bridge's state socket.
    bridge: SocketAddr,
}

impl Attacked {
    fn start() -> Self {
        let address = address();
        let options = ServerOptions { pace: Pace::LockStep, ..ServerOptions::default() };
        let server = Server::bind(address, options).unwrap();
        let link = connect(address);
        wait_for(&link, "a link that is ready", || link.unready().is_none());
        let strangers = [IpAddr::V4(Ipv4Addr::LOCALHOST), address.ip()].map(|ip| {
            let socket = UdpSocket::bind((ip, 0)).unwrap();
            socket.set_nonblocking(true).unwrap();
            socket
        });
        let bridge = SocketAddr::from(([127, 0, 0, 1], client_port(address)));
        let attacked = Self { server, link, strangers, bridge };
        attacked.moves_on();
        attacked
    }

    /// Waits until the motion has gone on.
    fn moves_on(&self) {
        let from = self.server.handle().snapshot().message_id;
        wait_for(&self.link, "the motion", || {
            self.link.follow(true);
            let following = self.link.measured().is_some_and(|m| m.phase == Phase::Following);
            following && self.server.handle().snapshot().message_id > from + CYCLES
        });
    }

    /// Sends a datagram of each stranger.
    fn send(&self, datagram: &[u8]) {
        for stranger in &self.strangers {
            assert_eq!(stranger.send_to(datagram, self.bridge).unwrap(), datagram.len());
        }
        self.link.follow(true);
    }

    /// Asserts that the motion goes on without a lost state, and that the strangers have got nothing.
    fn is_unmoved(&self) {
        self.moves_on();
        assert_eq!(self.link.take_end(), None);
        assert_eq!(self.link.figures().lost_states, 0);
        for stranger in &self.strangers {
            let mut commands = 0;
            while stranger.recv_from(&mut [0; 512]).is_ok() {
                commands += 1;
            }
            assert_eq!(commands, 0, "commands that a stranger got");
        }
    }
}

/// Returns the port to which the emulated arm at this address sends its states, from the kernel's table of sockets.
fn client_port(robot: SocketAddr) -> u16 {
    let IpAddr::V4(ip) = robot.ip() else { panic!("{robot}") };
    let local = format!("{:08X}:{:04X}", u32::from_ne_bytes(ip.octets()), robot.port());
    let table = std::fs::read_to_string("/proc/self/net/udp").unwrap();
    let rows = table.lines().map(|row| row.split_whitespace().collect::<Vec<_>>());
    let row = rows.into_iter().find(|row| row.get(1) == Some(&&*local)).unwrap();
    u16::from_str_radix(row[2].split_once(':').unwrap().1, 16).unwrap()
}

/// Bytes that look random, and are the same in each run: a linear congruential generator with Knuth's numbers.
fn noise(length: usize) -> Vec<u8> {
    let next = |x: &u64| Some(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407));
    std::iter::successors(Some(7), next).map(|x| (x >> 56) as u8).take(length).collect()
}

/// State of an arm in a motion by torques.
fn forged(message_id: u64) -> RobotState {
    let arm = Panda::new(Settings::default(), 1).unwrap();
    let motion = Some((Generator::JointVelocity, ControllerMode::External));
    RobotState { message_id, motion, robot_mode: RobotMode::Move, ..arm.state().clone() }
}

fn bytes(state: &RobotState) -> Vec<u8> {
    encode_state(Emulated::Panda, state, &mut [0; STATE_BYTES_MAX]).to_vec()
}

#[test]
fn random_bytes_do_not_end_a_motion() {
    let attacked = Attacked::start();
    for length in [10, 0, STATE_BYTES_MAX - 1] {
        attacked.send(&noise(length));
        attacked.is_unmoved();
    }
}

#[test]
fn a_datagram_that_is_too_long_is_not_cut_to_a_state() {
    let attacked = Attacked::start();
    for length in [STATE_BYTES_MAX + 1, 2400, 60_000] {
        attacked.send(&noise(length));
        attacked.is_unmoved();
    }
}

#[test]
fn forged_states_are_not_answered() {
    let attacked = Attacked::start();
    for number in 0..300 {
        attacked.send(&bytes(&forged(attacked.server.handle().snapshot().message_id + 2 + number)));
        std::thread::sleep(Duration::from_millis(1));
    }
    attacked.is_unmoved();
}

/// Robot that answers to a connection, and sends what its script makes of an idle arm's states.
struct FakeRobot {
    address: SocketAddr,
    script: AtomicU8,
}

/// Scripts of a fake robot.
const HONEST: u8 = 0;
/// Another program's state arrives before the robot's first one.
const FORGED_FIRST: u8 = 1;
/// The counter of a state leaps.
const LEAP: u8 = 2;
/// A state has a joint position that is no number.
const NAN: u8 = 3;

impl FakeRobot {
    fn start(script: u8) -> Arc<Self> {
        let robot = Arc::new(Self { address: address(), script: AtomicU8::new(script) });
        let listener = TcpListener::bind(robot.address).unwrap();
        let own = Arc::clone(&robot);
        std::thread::spawn(move || {
            // A connection that ends early is that of a client that was dropped.
            for stream in listener.incoming() {
                let _ended = own.serve(stream.unwrap());
            }
        });
        robot
    }

    fn serve(&self, mut stream: TcpStream) -> std::io::Result<()> {
        let mut request = [0; HEADER_BYTES + 4];
        stream.read_exact(&mut request)?;
        let port = u16::from_le_bytes([request[HEADER_BYTES + 2], request[HEADER_BYTES + 3]]);
        let client = SocketAddr::new(stream.peer_addr()?.ip(), port);
        let (own, stranger) = (UdpSocket::bind(self.address)?, UdpSocket::bind("127.0.0.1:0")?);
        if self.script.load(Ordering::Relaxed) == FORGED_FIRST {
            stranger.send_to(&bytes(&forged(1 << 40)), client)?;
        }
        let mut answer = Vec::new();
        encode_connect(Emulated::Panda, 0, true, &mut answer);
        stream.write_all(&answer)?;
        stream.set_nonblocking(true)?;
        let arm = Panda::new(Settings::default(), 1).unwrap();
        let mut state = RobotState { robot_mode: RobotMode::Other, ..arm.state().clone() };
        loop {
            state.message_id += 1;
            let script = if state.message_id > 200 { self.script.load(Ordering::Relaxed) } else { HONEST };
            match script {
                LEAP => state.message_id += 1 << 40,
                NAN => state.q[3] = f64::NAN,
                _ => {}
            }
            own.send_to(&bytes(&state), client)?;
            std::thread::sleep(Duration::from_millis(1));
            match stream.read(&mut [0; 64]) {
                Ok(0) => return Ok(()),
                Err(error) if error.kind() != std::io::ErrorKind::WouldBlock => return Err(error),
                _ => {}
            }
        }
    }
}

/// Waits until a link to a robot with this script says why it has no connection, and until it has one to an honest robot.
fn is_refused(script: u8, says: &str) {
    let robot = FakeRobot::start(script);
    let link = connect(robot.address);
    wait_for(&link, says, || link.unready().is_some_and(|why| why.contains(says)));
    robot.script.store(HONEST, Ordering::Relaxed);
    wait_for(&link, "an honest robot", || link.measured().is_some_and(|m| m.state.time.as_millis() > 200));
}

#[test]
fn a_first_state_of_another_program_is_noticed() {
    is_refused(FORGED_FIRST, "another program");
}

#[test]
fn a_counter_that_leaps_ends_the_connection() {
    is_refused(LEAP, "counter");
}

#[test]
fn a_state_without_numbers_ends_the_connection() {
    is_refused(NAN, "q of a state");
}
