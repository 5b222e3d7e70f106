//! Server and client of a test.

use franka::{
    FciVersion, FrankaError, FrankaResult, RealtimeConfig, Robot, RobotMode, RobotOptions, RobotState, VersionPolicy,
};
use panda_emulator::fci::MoveStatus;
use panda_emulator::server::{Event, Handle, Pace, Server, ServerOptions};
use std::cell::RefCell;
use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::time::{Duration, Instant};

/// Deadline of everything that a test waits for. Chosen: far above what a loaded machine needs.
const DEADLINE: Duration = Duration::from_secs(20);
/// Cut-off frequency of franka-rs that switches its filter off.
pub const NO_FILTER: f64 = franka::MAX_CUTOFF_FREQUENCY;

/// Server with its events.
pub struct Rig {
    pub server: Server,
    pub handle: Handle,
    events: RefCell<Vec<Event>>,
}

impl Rig {
    /// Panda in lock step.
    pub fn new() -> Self {
        Self::with(ServerOptions::default())
    }

    /// Server with options, in lock step.
    pub fn with(options: ServerOptions) -> Self {
        Self::at(Pace::LockStep, options)
    }

    /// Server with a pace and options.
    pub fn at(pace: Pace, options: ServerOptions) -> Self {
        let options = ServerOptions { pace, ..options };
        let server = Server::bind("127.0.0.1:0".parse().unwrap(), options).unwrap();
        let handle = server.handle();
        Self { server, handle, events: RefCell::default() }
    }

    /// Client of FCI 5.
    pub fn robot(&self) -> Robot {
        self.connect(FciVersion::V5).unwrap()
    }

    pub fn connect(&self, version: FciVersion) -> FrankaResult<Robot> {
        let options = RobotOptions::new(RealtimeConfig::Ignore).with_version(VersionPolicy::Exact(version));
        Robot::with_options(&self.server.address().to_string(), options)
    }

    /// All events so far.
    pub fn events(&self) -> Vec<Event> {
        self.events.borrow_mut().extend(self.handle.take_events().into_iter().map(|(_, event)| event));
        self.events.borrow().clone()
    }

    /// Waits until the events satisfy a condition.
    pub fn wait_for(&self, what: &str, holds: impl Fn(&[Event]) -> bool) {
        let began = Instant::now();
        while !holds(&self.events()) {
            assert!(began.elapsed() < DEADLINE, "{what} did not come: {:?}", self.events());
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Ends of motions so far, in order.
    pub fn ends(&self) -> Vec<MoveStatus> {
        let end = |event| if let Event::MotionEnded(status) = event { Some(status) } else { None };
        self.events().into_iter().filter_map(end).collect()
    }
}

/// Reads states until the mode has come.
pub fn wait_for_mode(robot: &Robot, mode: RobotMode) -> RobotState {
    let began = Instant::now();
    loop {
        let state = robot.read_once().unwrap();
        if state.robot_mode == mode {
            return state;
        }
        assert!(began.elapsed() < DEADLINE, "expected mode {mode:?}, got {:?}", state.robot_mode);
    }
}

/// Asserts that a motion ended in a reflex with this error, and that recovery works.
pub fn assert_reflex(robot: &Robot, result: FrankaResult<()>, error: &str) {
    let Err(FrankaError::Control(exception)) = result else { panic!("expected {error}, got {result:?}") };
    let names = exception.last_motion_errors.names();
    assert!(names.contains(&error), "expected {error}, got {names:?}: {}", exception.message);
    assert_eq!(exception.move_status, Some(franka::MoveStatus::ReflexAborted));
    assert_eq!(wait_for_mode(robot, RobotMode::Reflex).robot_mode, RobotMode::Reflex);
}

/// Recovers from a reflex.
pub fn recover(robot: &Robot) {
    robot.automatic_error_recovery().unwrap();
    wait_for_mode(robot, RobotMode::Idle);
}

/// Client that speaks bytes, for what franka-rs does not send.
pub struct RawClient {
    pub stream: TcpStream,
    pub datagrams: UdpSocket,
    next_id: u32,
}

impl RawClient {
    /// Opens both sockets and sends nothing.
    pub fn new(rig: &Rig) -> Self {
        let stream = TcpStream::connect(rig.server.address()).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        let datagrams = UdpSocket::bind("127.0.0.1:0").unwrap();
        datagrams.set_read_timeout(Some(DEADLINE)).unwrap();
        Self { stream, datagrams, next_id: 0 }
    }

    /// Client with a running motion that has answered so many states, with torques of zero.
    pub fn in_motion(rig: &Rig, answered: u32) -> Self {
        let mut client = Self::new(rig);
        assert_eq!(client.connect(5), (0, 5));
        let mut motion = [0; 56];
        (motion[0], motion[4]) = (2, 1);
        client.send(1, &motion);
        assert_eq!(client.receive(), (1, vec![1]));
        // States that left before the first command may wait in the socket of a client that was late.
        loop {
            let newest = rig.handle.snapshot().message_id;
            if client.answer() >= newest {
                break;
            }
        }
        for _ in 0..answered {
            client.answer();
        }
        client
    }

    /// Sends a request.
    pub fn send(&mut self, command: u32, payload: &[u8]) {
        let size = u32::try_from(payload.len()).unwrap() + 12;
        let header = [command, self.next_id, size].map(u32::to_le_bytes).concat();
        self.next_id += 1;
        self.stream.write_all(&[&header, payload].concat()).unwrap();
    }

    /// Sends `Connect` and returns status and version of the answer.
    pub fn connect(&mut self, version: u16) -> (u8, u16) {
        let port = self.datagrams.local_addr().unwrap().port();
        self.send(0, &[version.to_le_bytes(), port.to_le_bytes()].concat());
        let (command, payload) = self.receive();
        assert_eq!((command, payload.len()), (0, 3));
        (payload[0], u16::from_le_bytes([payload[1], payload[2]]))
    }

    /// Receives an answer: command and payload.
    pub fn receive(&mut self) -> (u32, Vec<u8>) {
        let mut header = [0; 12];
        self.stream.read_exact(&mut header).unwrap();
        let number = |at: usize| u32::from_le_bytes(header[at..at + 4].try_into().unwrap());
        let mut payload = vec![0; number(8) as usize - 12];
        self.stream.read_exact(&mut payload).unwrap();
        (number(0), payload)
    }

    /// Receives a state: identifier and size.
    pub fn receive_state(&self) -> (u64, usize) {
        let mut datagram = [0; 4096];
        let size = self.datagrams.recv(&mut datagram).unwrap();
        (u64::from_le_bytes(datagram[..8].try_into().unwrap()), size)
    }

    /// Receives a state and answers it with torques of zero. Returns its identifier.
    pub fn answer(&self) -> u64 {
        let mut datagram = [0; 4096];
        let (_, server) = self.datagrams.recv_from(&mut datagram).unwrap();
        let mut command = [0; 370];
        command[..8].copy_from_slice(&datagram[..8]);
        self.datagrams.send_to(&command, server).unwrap();
        u64::from_le_bytes(datagram[..8].try_into().unwrap())
    }

    /// Returns true if the server closed the connection.
    pub fn is_closed(&mut self) -> bool {
        // A timeout of the read is no end.
        match self.stream.read(&mut [0; 64]) {
            Ok(count) => count == 0,
            Err(error) => error.kind() == std::io::ErrorKind::ConnectionReset,
        }
    }
}

/// Prints the row of a check.
pub fn row(check: u32, result: &str) {
    println!("check {check:2} franka-rs: {result}");
}
