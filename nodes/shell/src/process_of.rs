//! The process behind a UDP address of this machine, as /proc tells it.

use std::collections::BTreeSet;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::path::Path;

/// Process number of the owner of a UDP socket that receives at one of the addresses.
///
/// None: an address is another machine's or another container's, or the owner is another user's process.
pub(crate) fn process_at(addresses: &[SocketAddr]) -> Option<u32> {
    if !are_local(addresses) {
        return None;
    }
    let table = std::fs::read_to_string("/proc/self/net/udp").ok()?;
    let inode = addresses.iter().find_map(|address| inode_of(&table, *address))?;
    owner(&format!("socket:[{inode}]"))
}

/// Whether all addresses of a participant are this machine's, so that it runs here. One alone tells nothing: every machine with
/// Docker has 172.17.0.1.
pub(crate) fn are_local(addresses: &[SocketAddr]) -> bool {
    !addresses.is_empty() && addresses.iter().all(|address| is_local(address.ip()))
}

/// Whether an address is one of this machine's.
pub(crate) fn is_local(ip: IpAddr) -> bool {
    ip.is_loopback() || UdpSocket::bind((ip, 0)).is_ok()
}

/// Inode of the socket that receives at an IPv4 address, from the table of the kernel.
///
/// A row: number, `0100007F:1CF2` (address in the machine's byte order, port), peer, state, queues, timer, retransmits,
/// user, timeout, inode.
fn inode_of(table: &str, address: SocketAddr) -> Option<u64> {
    let SocketAddr::V4(address) = address else { return None };
    table.lines().skip(1).find_map(|row| {
        let words: Vec<&str> = row.split_whitespace().collect();
        let (ip, port) = words.get(1)?.split_once(':')?;
        let ip = u32::from_str_radix(ip, 16).ok()?.to_ne_bytes();
        let port = u16::from_str_radix(port, 16).ok()?;
        let receives = port == address.port() && (ip == [0; 4] || ip == address.ip().octets());
        if receives { words.get(9)?.parse().ok() } else { None }
    })
}

/// UDP ports of this machine (of this network namespace) that somebody receives at.
pub(crate) fn bound_ports() -> BTreeSet<u16> {
    let tables =
        ["/proc/self/net/udp", "/proc/self/net/udp6"].map(|path| std::fs::read_to_string(path).unwrap_or_default());
    let port = |row: &str| u16::from_str_radix(row.split_whitespace().nth(1)?.rsplit_once(':')?.1, 16).ok();
    tables.iter().flat_map(|table| table.lines().skip(1)).filter_map(port).collect()
}

/// The process that has a file with this target open.
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
    }
}
