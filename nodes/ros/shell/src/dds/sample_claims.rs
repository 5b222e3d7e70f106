//! Limits on the memory that received fragments claim.
//!
//! A large sample arrives in fragments, and each names the size of the whole. RustDDS 0.15.1 allocates and zeroes that size at the
//! first fragment, of any sender, for a reader that exists in every participant: one datagram of 1 kB took 4 GiB. It keeps up to
//! 128 incomplete samples of a writer, of any number of writers. Therefore [`super::system_calls`] asks here before RustDDS gets a
//! message.
//!
//! The account of open samples follows RustDDS: a sample is open from its first fragment until all fragments were there, until its
//! writer has 128 younger ones, or until 10 s without a fragment. It errs in two cases, for which the limit on a node's memory
//! exists: RustDDS frees old samples only when the same reader gets another fragment, and several readers of one topic get a buffer
//! each for a message that names none of them.

use super::fragments::{Entity, Fragments, Participant, fragments, participant};
use crate::error::ShellError;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Environment variable with the size of the largest message that a process receives, MiB.
const VARIABLE: &str = "CATENARY_MESSAGE_LIMIT_MIB";
/// Default of the variable. An image of 3840 x 2160 in three colours has 24 MiB.
const DEFAULT_MIB: u32 = 64;
/// Largest value of the variable: a sample has at most 4 GiB.
const MAX_MIB: u32 = 4095;
const MIB: u64 = 1 << 20;

/// Size of the largest message of discovery, bytes. The endpoints of a participant are announced one by one, in some 100 bytes each.
const DISCOVERY: u64 = MIB;
/// Memory of all open samples, in largest messages.
const OPEN: u64 = 16;
/// Least size that an open sample counts for, bytes: the account itself needs memory.
const LEAST: u64 = 4096;
/// Open samples that RustDDS keeps of a writer.
const OF_A_WRITER: usize = 128;
/// Time after the last fragment at which RustDDS may free an open sample.
const PATIENCE: Duration = Duration::from_secs(10);

/// Bits of an entity's kind that a user's entities lack: those of discovery and of vendors have them (RTPS 2.5, section 9.3.1.2).
const NOT_OF_USERS: u8 = 0xc0;

/// Number of refused messages.
static REFUSED: AtomicU64 = AtomicU64::new(0);
static CLAIMS: Mutex<Claims> = Mutex::new(Claims::new(DEFAULT_MIB as u64 * MIB));

/// Reads the size of the largest message from the environment.
pub(crate) fn set_limit(variable: &dyn Fn(&str) -> Option<String>) -> Result<(), ShellError> {
    let Some(value) = variable(VARIABLE).filter(|value| !value.is_empty()) else { return Ok(()) };
    let mib = value.parse().ok().filter(|mib| (1..=MAX_MIB).contains(mib)).ok_or(ShellError::Environment {
        variable: VARIABLE,
        value,
        expected: "an integer from 1 to 4095",
    })?;
    CLAIMS.lock().unwrap_or_else(PoisonError::into_inner).largest = u64::from(mib) * MIB;
    Ok(())
}

/// Returns the number of messages that were refused since the start.
pub(crate) fn refused() -> u64 {
    REFUSED.load(Ordering::Relaxed)
}

/// Returns true for a message that claims too much memory, and accounts for any other.
pub(super) fn refuses(message: &[u8]) -> bool {
    let Some(sender) = participant(message) else { return false };
    let found: Vec<_> = fragments(message).collect();
    if found.is_empty() {
        return false;
    }
    let mut claims = CLAIMS.lock().unwrap_or_else(PoisonError::into_inner);
    let objection = found.into_iter().find_map(|one| claims.admit(sender, one, Instant::now()).err());
    drop(claims);
    let Some(reason) = objection else { return false };
    // A flood of them must not become a flood of lines.
    if (REFUSED.fetch_add(1, Ordering::Relaxed) + 1).is_power_of_two() {
        let sender: String = sender.iter().map(|byte| format!("{byte:02x}")).collect();
        tracing::warn!("a message of DDS participant {sender} was dropped: {reason} ({} so far)", refused());
    }
    true
}

type Writer = (Participant, Entity);

/// Account of the open samples of a process.
struct Claims {
    /// Size of the largest message, bytes.
    largest: u64,
    open: BTreeMap<Writer, BTreeMap<i64, Sample>>,
    /// Memory of all open samples, bytes.
    bytes: u64,
}

/// Open sample.
struct Sample {
    /// Memory of a reader's buffer, bytes.
    bytes: u64,
    readers: BTreeSet<Entity>,
    /// Fragments that have not come: a bit each.
    missing: Vec<u64>,
    left: u32,
    last: Instant,
}

impl Sample {
    fn new(total: u32, bytes: u64, now: Instant) -> Self {
        let mut missing = vec![u64::MAX; total.div_ceil(u64::BITS) as usize];
        if let Some(last) = missing.last_mut().filter(|_| !total.is_multiple_of(u64::BITS)) {
            *last = (1 << (total % u64::BITS)) - 1;
        }
        Self { bytes, readers: BTreeSet::new(), missing, left: total, last: now }
    }

    /// Memory of all readers' buffers, bytes.
    fn all(&self) -> u64 {
        self.bytes * self.readers.len() as u64
    }

    /// Marks fragments as received. Numbers beyond the total, of a sender that contradicts itself, have no bit.
    fn receive(&mut self, fragments: &Fragments) {
        for number in (fragments.first - 1..).take(usize::from(fragments.count)) {
            let bit = 1 << (number % u64::BITS);
            if let Some(bits) = self.missing.get_mut((number / u64::BITS) as usize).filter(|bits| **bits & bit != 0) {
                *bits &= !bit;
                self.left = self.left.saturating_sub(1);
            }
        }
    }
}

impl Claims {
    const fn new(largest: u64) -> Self {
        Self { largest, open: BTreeMap::new(), bytes: 0 }
    }

    /// Accounts for fragments, or returns the reason why they are refused.
    fn admit(&mut self, sender: Participant, fragments: Option<Fragments>, now: Instant) -> Result<(), String> {
        let Some((fragments, total)) = fragments.and_then(|f| Some((f, f.total()?))) else {
            return Err("its fragments contradict themselves".to_owned());
        };
        let is_of_users = |entity: Entity| entity[3] & NOT_OF_USERS == 0;
        let limit = match is_of_users(fragments.reader) && is_of_users(fragments.writer) {
            true => self.largest,
            false => DISCOVERY.min(self.largest),
        };
        let size = u64::from(fragments.sample);
        if size > limit {
            return Err(format!(
                "it is a fragment of {} MiB, and the limit is {} MiB ({VARIABLE})",
                size.div_ceil(MIB),
                limit / MIB
            ));
        }
        // The sample, and a bit for each fragment in RustDDS and here.
        let bytes = (size + u64::from(total) / 4).max(LEAST);
        let writer = (sender, fragments.writer);
        let known = self.open.get(&writer).and_then(|samples| samples.get(&fragments.sequence));
        let is_new = known.is_none_or(|sample| !sample.readers.contains(&fragments.reader));
        let all = OPEN * self.largest;
        if is_new && self.bytes + known.map_or(bytes, |sample| sample.bytes) > all {
            self.forget_old(now);
            if self.bytes + bytes > all {
                return Err(format!("incomplete messages have {} MiB already (16 times {VARIABLE})", self.bytes / MIB));
            }
        }
        self.enter(writer, &fragments, Sample::new(total, bytes, now));
        Ok(())
    }

    /// Enters fragments into their sample, which is `new` if it was not open.
    fn enter(&mut self, writer: Writer, fragments: &Fragments, new: Sample) {
        let samples = self.open.entry(writer).or_default();
        let last = new.last;
        let sample = samples.entry(fragments.sequence).or_insert(new);
        sample.last = last;
        if sample.readers.insert(fragments.reader) {
            self.bytes += sample.bytes;
        }
        sample.receive(fragments);
        if sample.left == 0
            && let Some(sample) = samples.remove(&fragments.sequence)
        {
            self.bytes -= sample.all();
        }
        while samples.len() > OF_A_WRITER {
            self.bytes -= samples.pop_first().map_or(0, |(_, sample)| sample.all());
        }
        if let Entry::Occupied(samples) = self.open.entry(writer)
            && samples.get().is_empty()
        {
            samples.remove();
        }
    }

    /// Forgets samples of which nothing has come for [`PATIENCE`].
    fn forget_old(&mut self, now: Instant) {
        self.open.retain(|_, samples| {
            samples.retain(|_, sample| {
                let is_open = now.saturating_duration_since(sample.last) < PATIENCE;
                self.bytes -= if is_open { 0 } else { sample.all() };
                is_open
            });
            !samples.is_empty()
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::fragments::tests::{FIRST, data_frag, message};
    use super::*;

    const SENDER: Participant = [9; 12];

    fn of(sample: u64, sequence: i64) -> Fragments {
        Fragments { sample: u32::try_from(sample).unwrap(), sequence, ..FIRST }
    }

    fn claims() -> Claims {
        Claims::new(64 * MIB)
    }

    /// Enters all fragments of a sample except the first `without`.
    fn complete(claims: &mut Claims, one: Fragments, without: u32) {
        for first in without + 1..=one.total().unwrap() {
            claims.admit(SENDER, Some(Fragments { first, ..one }), Instant::now()).unwrap();
        }
    }

    #[test]
    fn a_claim_beyond_the_limit_is_refused_and_a_smaller_one_for_discovery() {
        let now = Instant::now();
        let builtin = [[0, 0, 3, 0xc7], [0, 0, 3, 0xc2]];
        for (reader, writer, largest) in [
            (FIRST.reader, FIRST.writer, 64 * MIB),
            ([0; 4], FIRST.writer, 64 * MIB),
            (builtin[0], FIRST.writer, MIB),
            ([0; 4], builtin[1], MIB),
            (builtin[0], builtin[1], MIB),
        ] {
            let mut claims = claims();
            let one = Fragments { reader, writer, ..of(largest, 1) };
            claims.admit(SENDER, Some(one), now).unwrap();
            let reason =
                claims.admit(SENDER, Some(Fragments { sample: one.sample + 1, sequence: 2, ..one }), now).unwrap_err();
            assert!(reason.contains(&format!("limit is {} MiB", largest / MIB)), "{reason}");
            assert_eq!(claims.bytes, largest + largest / 1024 / 4, "a refused claim is not accounted for");
        }
        assert!(claims().admit(SENDER, Some(Fragments { first: 0, ..FIRST }), now).is_err());
        assert!(claims().admit(SENDER, None, now).is_err());
    }

    #[test]
    fn all_open_samples_together_have_a_limit_whoever_claims_them() {
        let (mut claims, now) = (claims(), Instant::now());
        let claim = |claims: &mut Claims, number: u8, at| {
            let reader = [0, 0, number, 4];
            let writers = [(SENDER, FIRST.writer), ([number; 12], FIRST.writer), (SENDER, [number, 0, 2, 3])];
            let (sender, writer) = writers[usize::from(number) % 3];
            claims.admit(sender, Some(Fragments { reader, writer, ..of(63 * MIB, i64::from(number)) }), at)
        };
        let accepted = (1..=100).filter(|number| claim(&mut claims, *number, now).is_ok()).count();
        assert_eq!(accepted, 16);
        assert!(claims.bytes <= 16 * 64 * MIB);
        // A sample that is open already may go on, and small messages are heard.
        claim(&mut claims, 1, now).unwrap();
        claims.admit(SENDER, Some(of(4096, 1000)), now).unwrap();
        // Without a fragment for 10 s they no longer count.
        claim(&mut claims, 101, now + PATIENCE).unwrap();
        assert_eq!(claims.open.values().map(BTreeMap::len).sum::<usize>(), 1);
    }

    #[test]
    fn readers_of_one_sample_have_a_buffer_each() {
        let (mut claims, now) = (claims(), Instant::now());
        let accepted = (1..=100).filter(|number| {
            let one = Fragments { reader: [0, 0, *number, 4], ..of(60 * MIB, 1) };
            claims.admit(SENDER, Some(one), now).is_ok()
        });
        assert_eq!(accepted.count(), 17);
    }

    #[test]
    fn complete_samples_do_not_count_and_incomplete_ones_are_replaced_as_in_rustdds() {
        let mut claims = claims();
        for sequence in 1..=1000 {
            complete(&mut claims, of(300_000, sequence), 0);
        }
        assert!(claims.open.is_empty() && claims.bytes == 0);
        // A stream of images of which each loses a fragment.
        for sequence in 1..=1000 {
            complete(&mut claims, of(921_665, sequence), 1);
        }
        let samples = &claims.open[&(SENDER, FIRST.writer)];
        assert_eq!((samples.len(), samples.keys().next()), (128, Some(&873)));
        assert_eq!(claims.bytes, 128 * (921_665 + 901 / 4));
        // Repeated fragments complete nothing.
        for _ in 0..2000 {
            claims.admit(SENDER, Some(of(921_665, 1001)), Instant::now()).unwrap();
        }
        assert_eq!(claims.open[&(SENDER, FIRST.writer)][&1001].left, 900);
    }

    #[test]
    fn a_sender_that_contradicts_itself_does_no_harm() {
        let (mut claims, now) = (claims(), Instant::now());
        claims.admit(SENDER, Some(of(2048, 1)), now).unwrap();
        claims.admit(SENDER, Some(Fragments { first: 900, count: 78, ..of(1_000_000, 1) }), now).unwrap();
        claims.admit(SENDER, Some(Fragments { first: 1, count: 3, size: 1000, ..of(3000, 1) }), now).unwrap();
        assert!(claims.open.is_empty() && claims.bytes == 0);
    }

    #[test]
    fn whole_messages_are_refused_and_counted() {
        let whole = |fragments| message(SENDER, &[(0x09, 1, vec![0; 8]), data_frag(fragments, true)]);
        let before = refused();
        assert!(!refuses(b"no RTPS message"));
        assert!(!refuses(&message(SENDER, &[(0x15, 1, vec![0; 64])])));
        assert!(!refuses(&whole(of(4096, 1))));
        assert!(refuses(&whole(Fragments { sample: u32::MAX, size: 1024, ..FIRST })));
        assert_eq!(refused(), before + 1);
    }

    #[test]
    fn the_limit_is_read_from_the_environment() {
        let read = |value: &str| set_limit(&|_| Some(value.to_owned()));
        for wrong in ["0", "4096", "-1", "64MiB", "1e3"] {
            let message = read(wrong).unwrap_err().to_string();
            assert!(message.contains(VARIABLE) && message.contains(wrong), "{message}");
        }
        read("64").unwrap();
        read("").unwrap();
    }
}
