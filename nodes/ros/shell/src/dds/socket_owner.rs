//! Process behind a UDP address of this machine, from /proc.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::path::Path;

/// Table of the IPv4 UDP sockets of this network namespace.
const UDP_TABLE: &str = "/proc/self/net/udp";
/// Column of the inode in a row of the table, from 0.
const INODE_COLUMN: usize = 9;

/// Returns the process number of the owner of a UDP socket that receives at one of the addresses.
///
/// Returns `None` if an address belongs to another machine or container, or the owner is a process of another user.
pub(crate) fn process_at(addresses: &[SocketAddr]) -> Option<u32> {
    owner(&format!("socket:[{}]", socket_at(addresses)?))
}

/// Returns the inode of a UDP socket that receives at one of the addresses; `None` if an address belongs to another machine or container.
pub(crate) fn socket_at(addresses: &[SocketAddr]) -> Option<u64> {
    if !are_local(addresses) {
        return None;
    }
    let table = std::fs::read_to_string(UDP_TABLE).ok()?;
    addresses.iter().find_map(|address| inode_of(&table, *address))
}

/// Returns true if all addresses of a participant belong to this machine. A single address proves nothing: every machine with
/// Docker has 172.17.0.1.
pub(crate) fn are_local(addresses: &[SocketAddr]) -> bool {
    !addresses.is_empty() && addresses.iter().all(|address| is_local(address.ip()))
}

/// Returns true if an address belongs to this machine: only then a socket can be bound to it.
pub(crate) fn is_local(ip: IpAddr) -> bool {
    ip.is_loopback() || UdpSocket::bind((ip, 0)).is_ok()
}

/// Returns the inode of the socket that receives at an IPv4 address, from the kernel's table.
///
/// A row holds number, `0100007F:1CF2` (address in the machine's byte order, port), peer, state, queues, timer, retransmits, user,
/// timeout and inode.
fn inode_of(table: &str, address: SocketAddr) -> Option<u64> {
    let SocketAddr::V4(address) = address else { return None };
    table.lines().skip(1).find_map(|row| {
        let words: Vec<&str> = row.split_whitespace().collect();
        let (ip, port) = words.get(1)?.split_once(':')?;
        // The kernel prints the address as one number in the machine's byte order.
        let ip = u32::from_str_radix(ip, 16).ok()?.to_ne_bytes();
        let port = u16::from_str_radix(port, 16).ok()?;
        // A socket bound to 0.0.0.0 receives at every address.
        let receives = port == address.port() && (ip == [0; 4] || ip == address.ip().octets());
        if receives { words.get(INODE_COLUMN)?.parse().ok() } else { None }
    })
}

/// Returns the inode of the IPv4 socket that is bound to a UDP port of this network namespace.
pub(crate) fn inode_at(port: u16) -> Option<u64> {
    let table = std::fs::read_to_string(UDP_TABLE).ok()?;
    inode_of(&table, (Ipv4Addr::LOCALHOST, port).into())
}

/// Returns true if the UDP socket with this inode is still bound, or the kernel's table cannot be read.
pub(crate) fn is_bound(inode: u64) -> bool {
    let inode = inode.to_string();
    std::fs::read_to_string(UDP_TABLE).map_or(true, |table| {
        table.lines().skip(1).any(|row| row.split_whitespace().nth(INODE_COLUMN) == Some(&*inode))
    })
}

/// Returns the bound UDP ports of this network namespace.
pub(crate) fn bound_ports() -> BTreeSet<u16> {
    let tables = [UDP_TABLE, "/proc/self/net/udp6"].map(|path| std::fs::read_to_string(path).unwrap_or_default());
    let port = |row: &str| u16::from_str_radix(row.split_whitespace().nth(1)?.rsplit_once(':')?.1, 16).ok();
    tables.iter().flat_map(|table| table.lines().skip(1)).filter_map(port).collect()
}

/// Returns the process that has a file with this link target open.
fn owner(target: &str) -> Option<u32> {
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    let number = |entry: std::fs::DirEntry| entry.file_name().to_str()?.parse::<u32>().ok();
    processes.filter_map(number).find(|pid| has_open(&Path::new("/proc").join(pid.to_string()).join("fd"), target))
}

fn has_open(descriptors: &Path, target: &str) -> bool {
    let Ok(entries) = std::fs::read_dir(descriptors) else { return false };
    entries.flatten().any(|entry| std::fs::read_link(entry.path()).is_ok_and(|link| link == Path::new(target)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_own_socket_is_this_process() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = socket.local_addr().unwrap();
        assert_eq!(process_at(&[address]), Some(std::process::id()));
        assert!(bound_ports().contains(&address.port()));
        let inode = inode_at(address.port()).unwrap();
        assert_eq!(socket_at(&[address]), Some(inode));
        assert!(is_bound(inode));
        let any = UdpSocket::bind("0.0.0.0:0").unwrap();
        let port = any.local_addr().unwrap().port();
        assert_eq!(process_at(&[([127, 0, 0, 1], port).into()]), Some(std::process::id()));
        // TEST-NET-1 of RFC 5737 belongs to no machine.
        let remote = ([192, 0, 2, 1], port).into();
        assert_eq!(process_at(&[remote]), None);
        let shared = ([127, 0, 0, 1], port).into();
        assert_eq!(process_at(&[shared, remote]), None, "another machine with an address that this one has, too");
        assert!(are_local(&[shared]) && !are_local(&[shared, remote]) && !are_local(&[]));
        drop(socket);
        assert_eq!(process_at(&[address]), None);
        assert!(!is_bound(inode), "a socket that was closed");
    }
}
