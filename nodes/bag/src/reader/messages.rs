//! Messages of a bag in order of their log times.

use super::chunk::{LARGEST, visit_records};
use super::contents::BagMessage;
use super::index::{IndexedFile, Piece, PieceKind, nanoseconds, read_body};
use super::sqlite;
use super::zstd_data::unpacked;
use crate::error::BagError;
use mcap::records::{Record, op};
use rusqlite::Connection;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::File;
use std::sync::Arc;

/// Open file of a bag.
enum Open {
    Mcap(File),
    Sqlite(Connection),
}

impl Open {
    fn new(file: &IndexedFile, kind: PieceKind) -> Result<Self, BagError> {
        match kind {
            PieceKind::Rows => sqlite::connect(&file.source).map(Self::Sqlite),
            PieceKind::Chunk | PieceKind::Message => {
                File::open(&file.source).map(Self::Mcap).map_err(BagError::io("open", &file.path))
            }
        }
    }
}

/// Messages of a bag in order of their log times. Messages of equal time keep the order in which they were written.
///
/// A chunk is read when its first log time is due, so memory holds only the chunks that overlap. A damaged chunk gives
/// one error, and no message if its checksum is wrong. A message that cannot be decompressed gives an error of its own.
pub struct Messages<'a> {
    files: &'a [IndexedFile],
    wanted: Option<BTreeSet<String>>,
    /// Index of the file, and piece, sorted by the piece's first log time.
    order: Vec<(usize, Piece)>,
    next: usize,
    open: Vec<Option<Open>>,
    /// Messages that were read, by log time, file, offset of the piece and index in it.
    ready: BTreeMap<(i64, usize, u64, usize), BagMessage>,
    errors: VecDeque<BagError>,
}

impl<'a> Messages<'a> {
    pub(super) fn new(files: &'a [IndexedFile], wanted: Option<BTreeSet<String>>) -> Self {
        let pieces = |(i, file): (usize, &IndexedFile)| file.pieces.iter().map(move |p| (i, *p)).collect::<Vec<_>>();
        let mut order: Vec<(usize, Piece)> = files.iter().enumerate().flat_map(pieces).collect();
        order.sort_by_key(|(file, piece)| (piece.span.0, *file, piece.offset));
        let open = files.iter().map(|_| None).collect();
        Self { files, wanted, order, next: 0, open, ready: BTreeMap::new(), errors: VecDeque::new() }
    }

    fn load(&mut self, index: usize, piece: Piece) -> Result<(), BagError> {
        let indexed = &self.files[index];
        let open = match &mut self.open[index] {
            Some(open) => open,
            slot => slot.insert(Open::new(indexed, piece.kind)?),
        };
        let damaged = |reason: String| BagError::Damaged { path: indexed.path.clone(), offset: piece.offset, reason };
        let (ready, errors, wanted) = (&mut self.ready, &mut self.errors, self.wanted.as_ref());
        let mut keep = |place: usize, message: BagMessage| {
            if wanted.is_some_and(|names| !names.contains(&message.topic.name)) {
                return;
            }
            // Messages of other topics are dropped above, before they are decompressed.
            let BagMessage { topic, log_time_ns, publish_time_ns, data } = message;
            match unpacked(data, LARGEST) {
                Ok(data) => {
                    let message = BagMessage { topic, log_time_ns, publish_time_ns, data };
                    ready.insert((log_time_ns, index, piece.offset, place), message);
                }
                Err(reason) => {
                    let (path, topic) = (indexed.path.clone(), topic.name.clone());
                    errors.push_back(BagError::Unpack { path, topic, log_time_ns, reason });
                }
            }
        };
        let file = match open {
            Open::Mcap(file) => file,
            Open::Sqlite(database) => {
                let read = sqlite::read(indexed, database, &piece, keep);
                return read.map_err(|reason| BagError::Database { path: indexed.path.clone(), reason });
            }
        };
        let body = read_body(file, piece.offset, piece.len).map_err(|e| damaged(e.to_string()))?;
        let mut place = 0;
        let mut take = |opcode: u8, body: &[u8]| {
            if opcode == op::MESSAGE {
                if let Some(message) = message(indexed, body)? {
                    keep(place, message);
                }
                place += 1;
            }
            Ok(())
        };
        let read = match piece.kind {
            PieceKind::Chunk => visit_records(&body, take).map(|_header| ()),
            _ => take(op::MESSAGE, &body),
        };
        read.map_err(damaged)
    }
}

/// Parses a message record; none if the file does not define its channel, which was noted.
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
            // A message before the start of every piece that is left can come next.
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
