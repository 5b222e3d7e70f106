//! Fragments in a received RTPS message (RTPS 2.5, sections 8.3.8.3 and 9.4.5), read as RustDDS reads them.
//!
//! RustDDS drops a message with a malformed submessage as a whole, so that reading may end at the first one.

/// Length of the header of a message: protocol, version, vendor, participant of the sender.
const MESSAGE_HEADER: usize = 20;
/// Length of the header of a submessage: kind, flags, length.
const SUBMESSAGE_HEADER: usize = 4;
/// Flag of a little-endian submessage.
const LITTLE_ENDIAN: u8 = 1;

const PAD: u8 = 0x01;
const INFO_TIMESTAMP: u8 = 0x09;
const DATA_FRAG: u8 = 0x16;

/// Length of the fixed part of a DATA_FRAG, to its inline QoS.
const FIXED: usize = 32;
/// Smallest offset of the inline QoS, counted from the end of its own field.
const TO_INLINE_QOS: u16 = 28;

/// Identifier of a participant.
pub(super) type Participant = [u8; 12];
/// Identifier of a reader or a writer in its participant.
pub(super) type Entity = [u8; 4];

/// Fragments of one submessage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fragments {
    pub(super) reader: Entity,
    pub(super) writer: Entity,
    pub(super) sequence: i64,
    /// Number of the first fragment, from 1.
    pub(super) first: u32,
    pub(super) count: u16,
    /// Size of a fragment, bytes.
    pub(super) size: u16,
    /// Size of the whole sample, bytes.
    pub(super) sample: u32,
}

impl Fragments {
    /// Returns the number of fragments of the whole sample; `None` if the numbers contradict one another.
    pub(super) fn total(&self) -> Option<u32> {
        if self.size == 0 || u32::from(self.size) > self.sample || self.first == 0 || self.count == 0 {
            return None;
        }
        let total = self.sample.div_ceil(u32::from(self.size));
        let last = self.first.checked_add(u32::from(self.count) - 1)?;
        (last <= total && self.sequence > 0).then_some(total)
    }

    /// Reads the body of a DATA_FRAG.
    fn read(body: &[u8], is_little: bool) -> Option<Self> {
        let body: &[u8; FIXED] = body.first_chunk()?;
        let two = |at: usize| [body[at], body[at + 1]];
        let four = |at: usize| [body[at], body[at + 1], body[at + 2], body[at + 3]];
        let short = |at| if is_little { u16::from_le_bytes(two(at)) } else { u16::from_be_bytes(two(at)) };
        let long = |at| if is_little { u32::from_le_bytes(four(at)) } else { u32::from_be_bytes(four(at)) };
        (short(2) >= TO_INLINE_QOS).then(|| Self {
            reader: four(4),
            writer: four(8),
            // The high half is signed, the low one is not.
            sequence: (i64::from(long(12).cast_signed()) << 32) | i64::from(long(16)),
            first: long(20),
            count: short(24),
            size: short(26),
            sample: long(28),
        })
    }
}

/// Returns the sender of an RTPS message; `None` for other bytes.
pub(super) fn participant(message: &[u8]) -> Option<Participant> {
    let header: &[u8; MESSAGE_HEADER] = message.first_chunk()?;
    header.last_chunk().copied().filter(|_| header.starts_with(b"RTPS"))
}

/// Returns the fragments in an RTPS message, `None` for each DATA_FRAG that cannot be read.
pub(super) fn fragments(message: &[u8]) -> impl Iterator<Item = Option<Fragments>> + '_ {
    let mut rest = message.get(MESSAGE_HEADER..).unwrap_or_default();
    let submessages = std::iter::from_fn(move || {
        let (header, tail) = rest.split_first_chunk::<SUBMESSAGE_HEADER>()?;
        let [kind, flags, low, high] = *header;
        let is_little = flags & LITTLE_ENDIAN != 0;
        let length = if is_little { u16::from_le_bytes([low, high]) } else { u16::from_be_bytes([low, high]) };
        let length = match length {
            // The last submessage, which ends with the message (section 9.4.5.1.3).
            0 if kind != PAD && kind != INFO_TIMESTAMP => tail.len(),
            length => usize::from(length),
        };
        let (body, next) = tail.split_at_checked(length)?;
        rest = next;
        Some((kind, is_little, body))
    });
    submessages.filter(|(kind, _, _)| *kind == DATA_FRAG).map(|(_, is_little, body)| Fragments::read(body, is_little))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Message with `submessages`, each a kind, flags and a body.
    pub(crate) fn message(participant: Participant, submessages: &[(u8, u8, Vec<u8>)]) -> Vec<u8> {
        let mut bytes = [&b"RTPS\x02\x04\x01\x0f"[..], &participant].concat();
        for (kind, flags, body) in submessages {
            let length = u16::try_from(body.len()).unwrap();
            bytes.extend([*kind, *flags]);
            bytes.extend(if flags & 1 == 1 { length.to_le_bytes() } else { length.to_be_bytes() });
            bytes.extend(body);
        }
        bytes
    }

    /// Submessage with fragments and no payload.
    pub(crate) fn data_frag(of: Fragments, is_little: bool) -> (u8, u8, Vec<u8>) {
        let order = |value: u64, length: usize| {
            let bytes = value.to_be_bytes();
            let mut bytes = bytes[8 - length..].to_vec();
            if is_little {
                bytes.reverse();
            }
            bytes
        };
        let sequence = of.sequence.cast_unsigned();
        let mut body = [order(0, 2), order(28, 2)].concat();
        body.extend(of.reader.iter().chain(&of.writer));
        for (value, length) in [(sequence >> 32, 4), (sequence & 0xffff_ffff, 4), (of.first.into(), 4)] {
            body.extend(order(value, length));
        }
        for (value, length) in [(of.count.into(), 2), (of.size.into(), 2), (of.sample.into(), 4)] {
            body.extend(order(value, length));
        }
        (DATA_FRAG, u8::from(is_little), body)
    }

    pub(crate) const FIRST: Fragments = Fragments {
        reader: [0, 0, 1, 4],
        writer: [0, 0, 2, 3],
        sequence: (7 << 32) + 9,
        first: 1,
        count: 1,
        size: 1024,
        sample: 4096,
    };

    #[test]
    fn fragments_are_found_behind_other_submessages_in_both_byte_orders() {
        for is_little in [true, false] {
            let before =
                [(PAD, 1, vec![]), (INFO_TIMESTAMP, 3, vec![]), (0x0e, 0, vec![5; 12]), (0x80, 1, vec![0x16; 300])];
            let mut all = before.to_vec();
            all.push(data_frag(FIRST, is_little));
            all.push((0x07, 1, vec![0; 28]));
            let second = Fragments { sequence: 10, ..FIRST };
            all.push(data_frag(second, is_little));
            let bytes = message([3; 12], &all);
            assert_eq!(participant(&bytes), Some([3; 12]));
            assert_eq!(fragments(&bytes).collect::<Vec<_>>(), [Some(FIRST), Some(second)]);
            // The last submessage may leave its length out.
            let mut bytes = message([3; 12], &before);
            bytes.extend([DATA_FRAG, u8::from(is_little), 0, 0]);
            bytes.extend(data_frag(FIRST, is_little).2);
            assert_eq!(fragments(&bytes).collect::<Vec<_>>(), [Some(FIRST)]);
        }
    }

    #[test]
    fn what_rustdds_drops_is_no_fragment() {
        assert_eq!(participant(b"RTPS"), None);
        assert_eq!(participant(&[0; 64]), None);
        let whole = message([3; 12], &[data_frag(FIRST, true)]);
        // A submessage that is longer than the message.
        assert_eq!(fragments(&whole[..whole.len() - 1]).count(), 0);
        let short = (DATA_FRAG, 1, data_frag(FIRST, true).2[..20].to_vec());
        assert_eq!(fragments(&message([3; 12], &[short])).collect::<Vec<_>>(), [None]);
        for wrong in [
            Fragments { size: 0, ..FIRST },
            Fragments { size: 5000, ..FIRST },
            Fragments { first: 0, ..FIRST },
            Fragments { first: 5, ..FIRST },
            Fragments { count: 0, ..FIRST },
            Fragments { first: 2, count: 4, ..FIRST },
            Fragments { first: u32::MAX, count: u16::MAX, ..FIRST },
            Fragments { sequence: 0, ..FIRST },
            Fragments { sequence: -1, ..FIRST },
        ] {
            assert_eq!(wrong.total(), None, "{wrong:?}");
        }
        assert_eq!(Fragments { first: 2, count: 3, ..FIRST }.total(), Some(4));
        assert_eq!(Fragments { sample: 4097, ..FIRST }.total(), Some(5));
    }
}
