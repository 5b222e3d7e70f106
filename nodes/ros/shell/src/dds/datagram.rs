//! Large answers to other programs, sent as one datagram.
//!
//! RustDDS 0.15.1 splits an answer larger than the MTU into fragments, and writes a stray byte before the inline QoS of each. An
//! answer names its request in the inline QoS, so Fast DDS drops all fragments. Therefore an answer up to the limit of UDP is
//! first sent here, with the sequence number that RustDDS will assign. The kernel splits and joins the datagram, and the client
//! ignores the later fragments of an answer that it already has. A lost datagram is not repeated.

use ros2_client::RmwRequestId;
use rustdds::GUID;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Maximum size of an answer that RustDDS never splits, bytes: with its headers it fits into 1280 bytes, the minimum MTU of IPv6.
pub(super) const WHOLE: usize = 1024;

/// Maximum size of an answer in one datagram, bytes: the limit of UDP over IPv4 minus the RTPS headers.
pub(super) const MOST: usize = 65_507 - 160;

/// RTPS header (RTPS 2.5, section 9.4): version 2.4, vendor id of RustDDS.
const HEADER: [u8; 8] = [b'R', b'T', b'P', b'S', 2, 4, 0x01, 0x12];

/// Submessages with their flags (RTPS 2.5, section 9.4.5): all little-endian, DATA with inline QoS and payload.
const INFO_DESTINATION: [u8; 2] = [0x0e, 0x01];
const INFO_TIMESTAMP: [u8; 2] = [0x09, 0x01];
const DATA: [u8; 2] = [0x15, 0x07];

/// Parameters of the inline QoS that name the request: the one of DDS-RPC 1.0 and the one of Fast DDS.
const RELATED_SAMPLE: [u16; 2] = [0x0083, 0x800f];
const SENTINEL: [u8; 4] = [0x01, 0, 0, 0];

/// Answer to send in one datagram.
pub(super) struct Answer<'a> {
    /// Writer of answers.
    pub(super) writer: GUID,
    /// Sequence number of the answer.
    pub(super) sequence: i64,
    /// Request.
    pub(super) to: RmwRequestId,
    /// Answer in CDR with its encapsulation header.
    pub(super) cdr: &'a [u8],
}

impl Answer<'_> {
    /// Returns true if the answer is too large for RustDDS and fits into one datagram.
    pub(super) fn is_due(&self) -> bool {
        (WHOLE + 1..=MOST).contains(&self.cdr.len())
    }

    /// Sends the answer to all addresses of a reader. Fails only if every send fails: a machine announces addresses of all its
    /// networks, and some of them cannot be reached from here.
    pub(super) fn send(&self, addresses: &[SocketAddr]) -> std::io::Result<()> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let datagram = self.datagram(since);
        let mut outcome = Ok(());
        let mut is_sent = false;
        for address in addresses {
            let own: SocketAddr = match address {
                SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
                SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
            };
            match UdpSocket::bind(own).and_then(|socket| socket.send_to(&datagram, address)) {
                Ok(_) => is_sent = true,
                Err(error) => outcome = Err(error),
            }
        }
        if is_sent { Ok(()) } else { outcome }
    }

    /// Returns the RTPS message. `since` is the source timestamp since 1970.
    fn datagram(&self, since: Duration) -> Vec<u8> {
        let (own, client) = (self.writer.to_bytes(), self.to.writer_gid.to_bytes16());
        let mut bytes = [&HEADER[..], &own[..12]].concat();
        submessage(&mut bytes, INFO_DESTINATION, &client[..12]);
        let seconds = u32::try_from(since.as_secs()).unwrap_or(u32::MAX).to_le_bytes();
        let fraction = ((u64::from(since.subsec_nanos()) << 32) / 1_000_000_000) as u32;
        submessage(&mut bytes, INFO_TIMESTAMP, &[seconds, fraction.to_le_bytes()].concat());
        // No extra flags; 16 octets to the inline QoS; reader id 0, for any reader that the writer is matched with.
        let mut data = vec![0, 0, 16, 0, 0, 0, 0, 0];
        data.extend_from_slice(&own[12..]);
        data.extend_from_slice(&sequence_number(self.sequence));
        for parameter in RELATED_SAMPLE {
            data.extend_from_slice(&parameter.to_le_bytes());
            data.extend_from_slice(&24_u16.to_le_bytes());
            data.extend_from_slice(&client);
            data.extend_from_slice(&sequence_number(self.to.sequence_number));
        }
        data.extend_from_slice(&SENTINEL);
        data.extend_from_slice(self.cdr);
        submessage(&mut bytes, DATA, &data);
        bytes
    }
}

fn submessage(bytes: &mut Vec<u8>, kind: [u8; 2], body: &[u8]) {
    bytes.extend_from_slice(&kind);
    // Cannot fail: a body is shorter than a datagram.
    bytes.extend_from_slice(&u16::try_from(body.len()).unwrap_or(0).to_le_bytes());
    bytes.extend_from_slice(body);
}

/// Encodes a sequence number: high half, then low half (RTPS 2.5, section 9.3.2).
fn sequence_number(number: i64) -> [u8; 8] {
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&((number >> 32) as i32).to_le_bytes());
    bytes[4..].copy_from_slice(&(number as u32).to_le_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::Gid;

    #[test]
    fn the_submessages_follow_one_another_and_the_last_ends_with_the_answer() {
        let cdr = vec![7; 2000];
        let to = RmwRequestId { writer_gid: Gid::from([2; 16]), sequence_number: (3 << 32) + 5 };
        let answer = Answer { writer: GUID::from_bytes([1; 16]), sequence: 9, to, cdr: &cdr };
        let bytes = answer.datagram(Duration::new(10, 500_000_000));
        assert_eq!(bytes[..20], [&HEADER[..], &[1; 12]].concat());
        let mut kinds = Vec::new();
        let mut rest = &bytes[20..];
        while let [kind, _, low, high, tail @ ..] = rest {
            let (body, next) = tail.split_at(usize::from(u16::from_le_bytes([*low, *high])));
            kinds.push((*kind, body));
            rest = next;
        }
        assert_eq!(kinds.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [0x0e, 0x09, 0x15]);
        assert_eq!(kinds[1].1, [10, 0, 0, 0, 0, 0, 0, 0x80]);
        let data = kinds[2].1;
        assert_eq!(data[8..20], [1, 1, 1, 1, 0, 0, 0, 0, 9, 0, 0, 0]);
        assert_eq!(data[20..24], [0x83, 0, 24, 0]);
        assert_eq!(data[40..48], [3, 0, 0, 0, 5, 0, 0, 0]);
        assert_eq!(data[data.len() - 2004..data.len() - 2000], SENTINEL);
        assert!(data.ends_with(&cdr));
    }

    #[test]
    fn an_unreachable_address_does_not_prevent_the_others() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        receiver.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let cdr = vec![7; 2000];
        let to = RmwRequestId { writer_gid: Gid::from([2; 16]), sequence_number: 1 };
        let answer = Answer { writer: GUID::from_bytes([1; 16]), sequence: 1, to, cdr: &cdr };
        // A socket may not send to the broadcast address without SO_BROADCAST.
        let closed: SocketAddr = ([255, 255, 255, 255], 9).into();
        assert!(answer.send(&[closed]).is_err());
        for addresses in [[closed, receiver.local_addr().unwrap()], [receiver.local_addr().unwrap(), closed]] {
            answer.send(&addresses).unwrap();
            assert!(receiver.recv(&mut [0; 4096]).unwrap() > 2000);
        }
    }

    #[test]
    fn small_answers_and_answers_beyond_one_datagram_are_left_to_rustdds() {
        let to = RmwRequestId::default();
        let due = |size| Answer { writer: GUID::from_bytes([1; 16]), sequence: 1, to, cdr: &vec![0; size] }.is_due();
        assert!(!due(WHOLE) && due(WHOLE + 1) && due(MOST) && !due(MOST + 1));
    }
}
