//! Filter of a participant that hears its own machine only.
//!
//! RustDDS 0.15.1 binds its sockets to every address, also where it announces the loopback address alone, so that any host could
//! send to them. The kernel's filter on the sockets drops such datagrams before they are queued. An address proves nothing: a
//! sender writes it. The filter asks for the interface over which a datagram came.

use super::system_calls::{attach_filter, listening_port};
use socket2::SockFilter;
use std::collections::BTreeMap;
use std::os::fd::RawFd;
use std::path::PathBuf;

/// Instructions of the classic Berkeley packet filter (`linux/bpf_common.h`).
const LOAD_WORD: u16 = 0x20;
const JUMP_IF_EQUAL: u16 = 0x15;
const RETURN: u16 = 0x06;

/// Fields of a datagram that the kernel knows (`linux/filter.h`): kind of the packet, number of its interface.
const PACKET_KIND: u32 = 0xffff_f000 + 4;
const INTERFACE: u32 = 0xffff_f000 + 8;

/// Number of the loopback interface, in every network namespace.
const LOOPBACK_INTERFACE: u32 = 1;
/// Kind of the kernel's copy of a multicast packet that this machine has sent over another interface (`linux/if_packet.h`).
const PACKET_LOOPBACK: u32 = 5;

/// Filter that drops datagrams of other machines.
fn filter() -> [SockFilter; 6] {
    let jump = |value, if_equal, otherwise| SockFilter::new(JUMP_IF_EQUAL, if_equal, otherwise, value);
    let statement = |code, value| SockFilter::new(code, 0, 0, value);
    [
        statement(LOAD_WORD, INTERFACE),
        jump(LOOPBACK_INTERFACE, 2, 0),
        statement(LOAD_WORD, PACKET_KIND),
        jump(PACKET_LOOPBACK, 0, 1),
        // Accept the whole datagram.
        statement(RETURN, u32::MAX),
        statement(RETURN, 0),
    ]
}

/// Socket of this process on which RustDDS listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Listener {
    descriptor: RawFd,
    pub(super) port: u16,
}

/// Returns the sockets of this process on which RustDDS listens, by the kernel's name of each, `socket:[INODE]`: a descriptor may be
/// reused.
pub(super) fn listeners() -> std::io::Result<BTreeMap<PathBuf, Listener>> {
    let listener = |entry: std::fs::DirEntry| {
        let descriptor = entry.file_name().to_str()?.parse().ok()?;
        let port = listening_port(descriptor)?;
        Some((std::fs::read_link(entry.path()).ok()?, Listener { descriptor, port }))
    };
    Ok(std::fs::read_dir("/proc/self/fd")?.flatten().filter_map(listener).collect())
}

/// Makes sockets hear this machine only, from the next datagram on.
pub(super) fn restrict<'a>(listeners: impl IntoIterator<Item = &'a Listener>) -> std::io::Result<()> {
    listeners.into_iter().try_for_each(|listener| attach_filter(listener.descriptor, &filter()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{Ipv4Addr, UdpSocket};
    use std::os::fd::AsRawFd;
    use std::time::Duration;

    fn listener(socket: &UdpSocket) -> Listener {
        Listener { descriptor: socket.as_raw_fd(), port: socket.local_addr().unwrap().port() }
    }

    #[test]
    fn a_restricted_socket_hears_this_machine_over_loopback_and_by_multicast() {
        let receiver = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap();
        receiver.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        restrict(&[listener(&receiver)]).unwrap();
        let port = receiver.local_addr().unwrap().port();
        let sender = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap();
        let mut heard = [0; 16];
        sender.send_to(b"unicast", (Ipv4Addr::LOCALHOST, port)).unwrap();
        assert_eq!(receiver.recv(&mut heard).unwrap(), 7);
        let group = Ipv4Addr::new(239, 255, 0, 1);
        receiver.join_multicast_v4(&group, &Ipv4Addr::LOCALHOST).unwrap();
        let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        socket2::SockRef::from(&sender).set_multicast_if_v4(&Ipv4Addr::LOCALHOST).unwrap();
        sender.send_to(b"multicast", (group, port)).unwrap();
        assert_eq!(receiver.recv(&mut heard).unwrap(), 9);
    }

    #[test]
    fn sockets_that_are_not_of_rustdds_are_left_alone() {
        let other = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap();
        assert!(!listeners().unwrap().values().any(|found| *found == listener(&other)));
        let closed = Listener { descriptor: -1, port: 1 };
        assert!(restrict(&[closed]).is_err());
    }
}
