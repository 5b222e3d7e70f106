//! Messages in order of their log times.

use super::chunk::{LARGEST, visit_records};
use super::file::{IndexedFile, Piece, Place, nanoseconds, read_body};
use super::{BagReader, Topic, sqlite};
use crate::error::BagError;
use catenary_msgs::Interface;
use mcap::records::{Record, op};
use rusqlite::Connection;
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::File;
use std::io::Read;
use std::sync::Arc;

/// A message of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct BagMessage {
    /// Its topic.
    pub topic: Arc<Topic>,
    /// When it was received, ns in the recorder's clock.
    pub log_time_ns: i64,
    /// When it was sent, ns in the sender's clock.
    pub publish_time_ns: i64,
    /// CDR with its encapsulation header.
    pub data: Vec<u8>,
}

impl BagMessage {
    /// The message as a `T`.
    ///
    /// # Errors
    /// [`BagError::Type`] where the topic has another type or another version of it, [`BagError::Message`] where the
    /// bytes are none.
    pub fn decode<T: Interface + DeserializeOwned>(&self) -> Result<T, BagError> {
        self.topic.check::<T>()?;
        catenary_msgs::from_cdr(&self.data).map_err(|e| BagError::Message {
            topic: self.topic.name.clone(),
            log_time_ns: self.log_time_ns,
            reason: e.to_string(),
        })
    }
}

/// A file that is being read.
enum Open {
    Mcap(File),
    Sqlite(Connection),
}

impl Open {
    fn new(file: &IndexedFile, place: Place) -> Result<Self, BagError> {
        match place {
            Place::Rows => sqlite::connect(&file.source).map(Self::Sqlite),
            Place::Chunk | Place::Message => {
                File::open(&file.source).map(Self::Mcap).map_err(BagError::io("open", &file.path))
            }
        }
    }
}

/// First bytes of what zstd packed. No message in CDR begins so.
pub(super) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// A message's bytes, unpacked where the recorder compressed message by message.
fn unpacked(data: Vec<u8>) -> Result<Vec<u8>, String> {
    if !data.starts_with(&ZSTD_MAGIC) {
        return Ok(data);
    }
    let mut out = Vec::new();
    let packed = zstd::Decoder::new(&data[..]).map_err(|e| e.to_string())?;
    let read = packed.take(LARGEST).read_to_end(&mut out);
    read.map(|_len| out).map_err(|e| format!("a message compressed by zstd: {e}"))
}

/// Messages of a bag in order of their log times; those of equal time in the order in which they were written.
///
/// Reads a chunk when its time has come, so that memory holds only the chunks that overlap. A chunk that is damaged gives
/// one error, and where its checksum is wrong no message. A message in it that cannot be unpacked costs itself alone; the
/// first of a chunk gives an error.
pub struct Messages<'a> {
    bag: &'a BagReader,
    wanted: Option<BTreeSet<String>>,
    /// File and piece, by start.
    order: Vec<(usize, Piece)>,
    next: usize,
    open: Vec<Option<Open>>,
    /// By log time, file, offset of the piece and place in it.
    ready: BTreeMap<(i64, usize, u64, usize), BagMessage>,
    errors: VecDeque<BagError>,
}

impl<'a> Messages<'a> {
    pub(super) fn new(bag: &'a BagReader, wanted: Option<BTreeSet<String>>) -> Self {
        let pieces = |(i, file): (usize, &IndexedFile)| file.pieces.iter().map(move |p| (i, *p)).collect::<Vec<_>>();
        let mut order: Vec<(usize, Piece)> = bag.files.iter().enumerate().flat_map(pieces).collect();
        order.sort_by_key(|(file, piece)| (piece.span.0, *file, piece.offset));
        let open = bag.files.iter().map(|_| None).collect();
        Self { bag, wanted, order, next: 0, open, ready: BTreeMap::new(), errors: VecDeque::new() }
    }

    fn load(&mut self, index: usize, piece: Piece) -> Result<(), BagError> {
        let indexed = &self.bag.files[index];
        let open = match &mut self.open[index] {
            Some(open) => open,
            slot => slot.insert(Open::new(indexed, piece.place)?),
        };
        let damaged = |reason: String| BagError::Damaged { path: indexed.path.clone(), offset: piece.offset, reason };
        let (ready, wanted) = (&mut self.ready, self.wanted.as_ref());
        let mut keep = |place: usize, message: BagMessage| {
            if wanted.is_some_and(|names| !names.contains(&message.topic.name)) {
                return Ok(());
            }
            let message = BagMessage { data: unpacked(message.data)?, ..message };
            ready.insert((message.log_time_ns, index, piece.offset, place), message);
            Ok::<(), String>(())
        };
        let file = match open {
            Open::Mcap(file) => file,
            Open::Sqlite(database) => {
                let mut first = Ok(());
                let read = sqlite::read(indexed, database, &piece, |place, message| {
                    let kept = keep(place, message);
                    first = std::mem::replace(&mut first, Ok(())).and(kept);
                });
                let reason = |reason: String| BagError::Database { path: indexed.path.clone(), reason };
                return read.and(first).map_err(reason);
            }
        };
        let body = read_body(file, piece.offset, piece.len).map_err(|e| damaged(e.to_string()))?;
        let (mut place, mut first) = (0, Ok(()));
        let mut take = |opcode: u8, body: &[u8]| {
            if opcode == op::MESSAGE {
                if let Some(message) = message(indexed, body)? {
                    let kept = keep(place, message);
                    first = std::mem::replace(&mut first, Ok(())).and(kept);
                }
                place += 1;
            }
            Ok(())
        };
        let read = match piece.place {
            Place::Chunk => visit_records(&body, take).map(|_header| ()),
            _ => take(op::MESSAGE, &body),
        };
        read.and(first).map_err(damaged)
    }
}

/// A message; none where the file does not define its channel, which was noted.
fn message(file: &IndexedFile, body: &[u8]) -> Result<Option<BagMessage>, String> {
    let Ok(Record::Message { header, data }) = mcap::parse_record(op::MESSAGE, body) else {
        return Err("a message's header is not readable".to_owned());
    };
    let Some(topic) = file.channels.get(&header.channel_id) else { return Ok(None) };
    Ok(Some(BagMessage {
        topic: Arc::clone(topic),
        log_time_ns: nanoseconds(header.log_time),
        publish_time_ns: nanoseconds(header.publish_time),
        data: data.into_owned(),
    }))
}

impl Iterator for Messages<'_> {
    type Item = Result<BagMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        while let Some((file, piece)) = self.order.get(self.next).copied() {
            let early = self.ready.first_key_value().is_some_and(|(key, _)| key.0 < piece.span.0);
            if early {
                break;
            }
            self.next += 1;
            if let Err(error) = self.load(file, piece) {
                self.errors.push_back(error);
            }
        }
        match self.errors.pop_front() {
            Some(error) => Some(Err(error)),
            None => self.ready.pop_first().map(|(_, message)| Ok(message)),
        }
    }
}
