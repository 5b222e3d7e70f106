//! State socket of a connection: the kernel passes it the states of the robot alone.
//!
//! franka-rs binds its UDP socket to every address, takes each datagram for a state, and sends its commands to the source of the last
//! one. Any host that finds the port could end a motion with one datagram, or get the arm's torques. A filter on the socket lets through
//! only datagrams of the robot's address, of the port that its states come from, and of a state's length. It stands from the first
//! connection on, before a motion can begin. `connect()` would do this too, but a connected socket also reports the ICMP messages that a
//! closed port sends, on which franka-rs ends the connection.
//!
//! franka-rs 0.4.0 has no access to its socket. `nodes/arm/panda_bridge/patches` has a change for it that makes this file superfluous.

use super::own_sockets::own_sockets;
use franka::wire::robot::{v5, v10};
use franka::{FciVersion, Robot};
use rustix::io::Errno;
use rustix::net::{RecvFlags, SocketType, getsockname, recvfrom, sockopt};
use socket2::{SockFilter, SockRef};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

/// Time in which states of several sources are told apart. A robot that sends from its own port is known by its first state.
const LISTENING: Duration = Duration::from_millis(300);
/// Greatest number of datagrams that are taken from the queue, which holds some 50 states.
const QUEUED: usize = 100_000;
/// Size of the UDP header, which the filter counts as part of a datagram, bytes.
const UDP_HEADER: usize = 8;

/// Sets the filter on the state socket of a connection to the robot at `address`.
///
/// # Errors
/// One line: the socket was not found, the system has no filters, no state of the robot came, or another program was heard before.
pub fn hear_robot_alone(robot: &Robot, address: SocketAddr) -> Result<(), String> {
    let SocketAddr::V4(address) = address else {
        return Err(format!("fci.host {address}: expected an IPv4 address, because the robot's states come by IPv4"));
    };
    let inside = Inside::of(&format!("{robot:?}")).ok_or("franka-rs does not tell the port of its state socket")?;
    let socket = own_sockets().find(|fd| is_bound_to(fd, inside.port)).ok_or_else(|| {
        format!("the state socket with port {} is not among this process's files in /proc/self/fd", inside.port)
    })?;
    let bytes = match robot.fci_version() {
        FciVersion::V5 => size_of::<v5::RobotState>(),
        FciVersion::V10 => size_of::<v10::RobotState>(),
    };
    filter(&socket, addresses(*address.ip()), None, bytes)?;
    discard_queue(&socket);
    let (source, message_id) = source(&socket, address, bytes)?;
    filter(&socket, (*source.ip(), u32::MAX), Some(source.port()), bytes)?;
    // Datagrams of other ports may have come since.
    discard_queue(&socket);
    // The library ignores states with a lower number than its last one: it would wait for ever.
    if message_id < inside.message_id {
        return Err(
            "the first state came from another program at this port, not from the robot: connecting again".to_owned()
        );
    }
    Ok(())
}

/// Data of a connection that franka-rs shows in its debug text alone.
#[derive(Debug, PartialEq)]
struct Inside {
    /// Port of the state socket.
    port: u16,
    /// Number of the newest state.
    message_id: u64,
}

impl Inside {
    fn of(text: &str) -> Option<Self> {
        let number = |owner: &str, field: &str| -> Option<u64> {
            let rest = text.split_once(owner)?.1.split_once(field)?.1;
            rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
        };
        let port = u16::try_from(number("UdpChannel {", " port: ")?).ok()?;
        Some(Self { port, message_id: number("data: State {", "message_id: ")? })
    }
}

fn is_bound_to(fd: &OwnedFd, port: u16) -> bool {
    let bound = getsockname(fd).ok().and_then(|name| SocketAddr::try_from(name).ok());
    bound == Some(SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)))
        && sockopt::socket_type(fd).is_ok_and(|kind| kind == SocketType::DGRAM)
}

/// Addresses that a robot's states may come from, and the mask of the bits that count: its own. A simulated robot of this machine
/// may send from another loopback address than the one it is reached at.
fn addresses(robot: Ipv4Addr) -> (Ipv4Addr, u32) {
    if robot.is_loopback() { (Ipv4Addr::new(127, 0, 0, 0), 0xff00_0000) } else { (robot, u32::MAX) }
}

/// Lets through datagrams of these addresses with this number of bytes; `None` lets through every port.
fn filter(socket: &OwnedFd, from: (Ipv4Addr, u32), port: Option<u16>, bytes: usize) -> Result<(), String> {
    let attached = SockRef::from(socket).attach_filter(&program(from, port, bytes));
    attached.map_err(|error| {
        format!("the system sets no filter on the state socket, so that others could be heard: {error}")
    })
}

/// Classic BPF program of the filter. The kernel runs it on a datagram from its UDP header on.
fn program((ip, mask): (Ipv4Addr, u32), port: Option<u16>, bytes: usize) -> Vec<SockFilter> {
    // Instructions of linux/bpf_common.h and linux/filter.h.
    const LOAD_WORD: u16 = 0x20;
    const LOAD_HALF: u16 = 0x28;
    const LOAD_LENGTH: u16 = 0x80;
    const AND: u16 = 0x54;
    const JUMP_IF_EQUAL: u16 = 0x15;
    const RETURN: u16 = 0x06;
    /// Offset of the source in the IP header, which is found at SKF_NET_OFF (-0x100000).
    const IP_SOURCE: u32 = 0xfff0_0000 + 12;
    const UDP_SOURCE: u32 = 0;
    let length = (bytes + UDP_HEADER) as u32;
    let mut checks = vec![(LOAD_WORD, IP_SOURCE, mask, u32::from(ip)), (LOAD_LENGTH, 0, u32::MAX, length)];
    checks.extend(port.map(|port| (LOAD_HALF, UDP_SOURCE, u32::MAX, u32::from(port))));
    let mut program = Vec::with_capacity(3 * checks.len() + 2);
    for (number, (load, at, mask, wanted)) in checks.iter().enumerate() {
        // A check that fails skips the later ones, and the acceptance.
        let skipped = 3 * (checks.len() - number - 1) + 1;
        program.push(SockFilter::new(*load, 0, 0, *at));
        program.push(SockFilter::new(AND, 0, 0, *mask));
        program.push(SockFilter::new(JUMP_IF_EQUAL, 0, skipped as u8, *wanted));
    }
    program.push(SockFilter::new(RETURN, 0, 0, u32::MAX));
    program.push(SockFilter::new(RETURN, 0, 0, 0));
    program
}

/// Takes the datagrams away that came before the filter.
fn discard_queue(socket: &OwnedFd) {
    for _ in 0..QUEUED {
        match recvfrom(socket, &mut [0_u8; 1], RecvFlags::DONTWAIT) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(_) => return,
        }
    }
}

/// Returns the source of the robot's states, and the number of the newest one.
///
/// A robot sends from the address and port of its TCP server. Other servers of the protocol may choose another source: it is taken if no
/// second one is heard.
fn source(socket: &OwnedFd, address: SocketAddrV4, bytes: usize) -> Result<(SocketAddrV4, u64), String> {
    let mut other: Option<(SocketAddrV4, u64)> = None;
    let start = Instant::now();
    while start.elapsed() < LISTENING {
        // Both versions begin with the number.
        let mut number = [0_u8; 8];
        // The library's timeout of one second holds.
        let from = match recvfrom(socket, &mut number, RecvFlags::empty()) {
            Ok((_, _, from)) => from.and_then(|from| SocketAddr::try_from(from).ok()),
            Err(Errno::INTR) => continue,
            Err(error) => {
                return Err(format!(
                    "no state of {bytes} bytes came from {} for 1 s ({error}): check the cable, and that no firewall drops UDP",
                    address.ip()
                ));
            }
        };
        let Some(SocketAddr::V4(from)) = from else { continue };
        let number = u64::from_le_bytes(number);
        if from == address {
            return Ok((from, number));
        }
        match other {
            Some((first, _)) if first != from => {
                return Err(format!(
                    "states come from {first} and {from}: another program sends some, and which one is unknown"
                ));
            }
            _ => other = Some((from, number)),
        }
    }
    other.ok_or_else(|| format!("no state came from {}", address.ip()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn the_port_and_the_number_are_read_from_the_debug_text() {
        let text = "Robot { robot: RobotImpl { network: Network { udp: UdpChannel { socket: UdpSocket { addr: 0.0.0.0:40123, fd: 9 }, \
            port: 40123, peer: Mutex { data: Some(127.0.0.1:1337), poisoned: false, .. } } }, version: V5, ri_version: 5, state: Mutex { \
            data: State { message_id: 77, robot_mode: Idle }, poisoned: false, .. } } }";
        assert_eq!(Inside::of(text), Some(Inside { port: 40123, message_id: 77 }));
        assert_eq!(Inside::of("Robot { .. }"), None);
    }

    #[test]
    fn one_source_and_one_length_pass() {
        let receiver = UdpSocket::bind("0.0.0.0:0").unwrap();
        receiver.set_nonblocking(true).unwrap();
        let to = SocketAddr::from(([127, 0, 0, 1], receiver.local_addr().unwrap().port()));
        let [robot, neighbour] = std::array::from_fn(|_| UdpSocket::bind("127.0.0.3:0").unwrap());
        let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
        let own = robot.local_addr().unwrap().port();
        let handle = OwnedFd::from(receiver.try_clone().unwrap());
        // 60,000 bytes travel in one piece by loopback, and 2,373 in two by Ethernet.
        for bytes in [2373, 1377, 60_000] {
            let heard = |port| {
                filter(&handle, (Ipv4Addr::new(127, 0, 0, 3), u32::MAX), port, bytes).unwrap();
                for sender in [&robot, &neighbour, &stranger] {
                    for length in [0, 10, bytes - 1, bytes, bytes + 1] {
                        sender.send_to(&vec![1; length], to).unwrap();
                    }
                }
                let mut heard = Vec::new();
                while let Ok((length, from)) = receiver.recv_from(&mut vec![0; 65_536]) {
                    heard.push((length, from));
                }
                heard
            };
            let [own_address, other] = [&robot, &neighbour].map(|socket| socket.local_addr().unwrap());
            assert_eq!(heard(None), [(bytes, own_address), (bytes, other)]);
            assert_eq!(heard(Some(own)), [(bytes, own_address)]);
            filter(&handle, addresses(Ipv4Addr::new(127, 9, 9, 9)), None, bytes).unwrap();
            stranger.send_to(&vec![1; bytes], to).unwrap();
            assert!(receiver.recv(&mut [0; 1]).is_ok(), "every loopback address may be a simulated robot's");
            filter(&handle, addresses(Ipv4Addr::new(172, 16, 0, 2)), None, bytes).unwrap();
            stranger.send_to(&vec![1; bytes], to).unwrap();
            assert!(receiver.recv(&mut [0; 1]).is_err());
        }
    }

    #[test]
    fn states_of_two_unknown_ports_are_refused_and_the_robots_own_port_decides() {
        let receiver = UdpSocket::bind("0.0.0.0:0").unwrap();
        receiver.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
        let to = SocketAddr::from(([127, 0, 0, 1], receiver.local_addr().unwrap().port()));
        let handle = OwnedFd::from(receiver.try_clone().unwrap());
        let [first, second] = std::array::from_fn(|_| UdpSocket::bind("127.0.0.1:0").unwrap());
        let port = |socket: &UdpSocket| socket.local_addr().unwrap().port();
        let send = |socket: &UdpSocket, number: u64| socket.send_to(&number.to_le_bytes(), to).unwrap();
        send(&first, 5);
        send(&second, 6);
        let robot = |port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
        let error = source(&handle, robot(1337), 8).unwrap_err();
        assert!(error.contains(&port(&first).to_string()) && error.contains(&port(&second).to_string()), "{error}");
        send(&first, 7);
        send(&second, 8);
        assert_eq!(source(&handle, robot(port(&second)), 8), Ok((robot(port(&second)), 8)));
        let silent = source(&handle, robot(1337), 8).unwrap_err();
        assert!(silent.contains("check the cable"), "{silent}");
    }
}
