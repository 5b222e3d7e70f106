//! Messages of a bag in order of their log times.

use super::chunk::{LARGEST, RECORD_HEADER, visit_records};
use super::contents::BagMessage;
use super::index::{IndexedFile, Piece, PieceKind, nanoseconds, read_body, read_run};
use super::scan::message_key;
use super::sqlite;
use super::usual::Usual;
use super::zstd_data::unpacked;
use crate::error::BagError;
use mcap::records::{Record, op};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// Limit in bytes of the messages that wait for their turn: 1 GiB, four of the largest chunks.
const MOST_HELD: usize = 1 << 30;
/// Number of bytes that a waiting message costs beside its data.
const ENTRY: usize = 160;

/// Open file of a bag.
enum Open {
    Mcap(File),
    /// Database that the index holds open.
    Sqlite,
}

impl Open {
    fn new(file: &IndexedFile, kind: PieceKind) -> Result<Self, BagError> {
        match kind {
            PieceKind::Rows => Ok(Self::Sqlite),
            PieceKind::Chunk | PieceKind::Run => {
                File::open(&file.source).map(Self::Mcap).map_err(BagError::io("open", &file.path))
            }
        }
    }
}

/// Messages of a bag in order of their log times. Messages of equal time keep the order in which they were written. A
/// message whose log time is far from the others (see [`crate::BagReader::far_notes`]) comes with the others of its chunk.
///
/// A chunk is read when its first log time is due, so memory holds only the chunks that overlap, as they are in the file:
/// a message that is compressed by itself is decompressed when its turn comes. A damaged chunk gives one error, and no
/// message if its checksum is wrong. A message that cannot be decompressed gives an error of its own. Chunks that overlap
/// by more than memory should hold give one error, and then their messages in another order. A signal that tells the process to
/// end gives a last error.
pub struct Messages<'a> {
    path: &'a Path,
    files: &'a [IndexedFile],
    usual: Usual,
    wanted: Option<BTreeSet<String>>,
    /// Indexes of file and piece, sorted by the piece's first log time.
    order: Vec<(usize, usize)>,
    next: usize,
    open: Vec<Option<Open>>,
    /// Messages that were read, by log time, file, offset of the piece and index in it.
    ready: BTreeMap<(i64, usize, u64, usize), BagMessage>,
    /// Number of bytes that `ready` takes.
    held: usize,
    most_held: usize,
    /// True once `held` was above its limit, which is one error.
    overflowed: bool,
    errors: VecDeque<BagError>,
    /// True after the error about a signal, which is the last one.
    interrupted: bool,
}

impl<'a> Messages<'a> {
    pub(super) fn new(
        path: &'a Path,
        files: &'a [IndexedFile],
        usual: Usual,
        wanted: Option<BTreeSet<String>>,
    ) -> Self {
        let mut order: Vec<(usize, usize)> = Vec::new();
        for (i, file) in files.iter().enumerate() {
            let is_wanted = |channel: &u16| {
                let topic = file.channels.get(channel);
                wanted.as_ref().is_none_or(|names| topic.is_some_and(|topic| names.contains(&topic.name)))
            };
            // A chunk of other topics alone is not read at all.
            let holds = |piece: &Piece| piece.channels.as_ref().is_none_or(|of_piece| of_piece.iter().any(is_wanted));
            order.extend(file.pieces.iter().enumerate().filter(|(_, p)| holds(p)).map(|(place, _)| (i, place)));
        }
        order.sort_by_key(|(file, place)| {
            let piece = &files[*file].pieces[*place];
            (piece.span.0, *file, piece.offset)
        });
        let open = files.iter().map(|_| None).collect();
        Self {
            path,
            files,
            usual,
            wanted,
            order,
            next: 0,
            open,
            ready: BTreeMap::new(),
            held: 0,
            most_held: MOST_HELD,
            overflowed: false,
            errors: VecDeque::new(),
            interrupted: false,
        }
    }

    /// Messages with another limit of those that wait.
    #[cfg(test)]
    pub(super) fn with_most_held(self, most_held: usize) -> Self {
        Self { most_held, ..self }
    }

    fn load(&mut self, index: usize, piece: &Piece) -> Result<(), BagError> {
        let indexed = &self.files[index];
        let open = match &mut self.open[index] {
            Some(open) => open,
            slot => slot.insert(Open::new(indexed, piece.kind)?),
        };
        let damaged = |reason: String| BagError::Damaged { path: indexed.path.clone(), offset: piece.offset, reason };
        let (ready, held, wanted, usual) = (&mut self.ready, &mut self.held, self.wanted.as_ref(), self.usual);
        let mut keep = |place: usize, message: BagMessage| {
            if wanted.is_some_and(|names| !names.contains(&message.topic.name)) {
                return;
            }
            let time_ns = if usual.holds(message.log_time_ns) { message.log_time_ns } else { piece.span.0 };
            *held += cost(&message);
            ready.insert((time_ns, index, piece.offset, place), message);
        };
        let file = match open {
            Open::Mcap(file) => file,
            Open::Sqlite => {
                let read = sqlite::read(indexed, piece, keep);
                return read.map_err(|reason| BagError::Database { path: indexed.path.clone(), reason });
            }
        };
        let mut place = 0;
        let take = |opcode: u8, body: &[u8]| {
            if opcode == op::MESSAGE {
                if let Some(message) = message(indexed, body)? {
                    keep(place, message);
                }
                place += 1;
            }
            Ok(())
        };
        visit_piece(file, piece, take).map_err(damaged)
    }

    /// Takes the earliest message that was read, and decompresses it.
    fn take(&mut self) -> Option<Result<BagMessage, BagError>> {
        let ((_, file, ..), message) = self.ready.pop_first()?;
        self.held -= cost(&message);
        let BagMessage { topic, log_time_ns, publish_time_ns, data } = message;
        Some(match unpacked(data, LARGEST) {
            Ok(data) => Ok(BagMessage { topic, log_time_ns, publish_time_ns, data }),
            Err(reason) => {
                let (path, topic) = (self.files[file].path.clone(), topic.name.clone());
                Err(BagError::Unpack { path, topic, log_time_ns, reason })
            }
        })
    }
}

/// Number of bytes of a waiting message.
fn cost(message: &BagMessage) -> usize {
    message.data.len() + ENTRY
}

/// Calls `visit` with opcode and body of every record of a chunk, or of a run of messages.
fn visit_piece(
    file: &mut File,
    piece: &Piece,
    mut visit: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<(), String> {
    if piece.kind == PieceKind::Chunk {
        let body = read_body(file, piece.offset, piece.len).map_err(|e| e.to_string())?;
        return visit_records(&body, visit).map(|_header| ());
    }
    let run = read_run(file, piece).map_err(|e| e.to_string())?;
    let mut left = &run[..];
    while let Some((head, rest)) = left.split_at_checked(RECORD_HEADER as usize) {
        let len = u64::from_le_bytes(head[1..].try_into().unwrap_or_default());
        let body = rest.split_at_checked(usize::try_from(len).unwrap_or(usize::MAX));
        let (body, later) = body.ok_or_else(|| "a record is longer than its run of messages".to_owned())?;
        visit(head[0], body)?;
        left = later;
    }
    Ok(())
}

/// Calls `visit` with channel and log time in ns, not clipped, of every message of a piece.
pub(super) fn visit_times(file: &IndexedFile, piece: &Piece, mut visit: impl FnMut(u16, i128)) -> Result<(), String> {
    match Open::new(file, piece.kind).map_err(|e| e.to_string())? {
        Open::Sqlite => sqlite::times(file, piece, visit),
        Open::Mcap(mut source) => visit_piece(&mut source, piece, |opcode, body| {
            if opcode == op::MESSAGE {
                let (channel, time) = message_key(body)?;
                visit(channel, i128::from(time));
            }
            Ok(())
        }),
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
        if catenary_shell::is_signalled() {
            let is_first = !std::mem::replace(&mut self.interrupted, true);
            return is_first.then(|| Err(BagError::Interrupted { path: self.path.to_owned() }));
        }
        let files = self.files;
        while let Some((file, place)) = self.order.get(self.next).copied() {
            let piece = &files[file].pieces[place];
            // A message before the start of every piece that is left can come next.
            let early = self.ready.first_key_value().is_some_and(|(key, _)| key.0 < piece.span.0);
            let is_full = self.held > self.most_held;
            if is_full && !self.overflowed {
                self.overflowed = true;
                self.errors.push_back(BagError::Overlap { path: self.path.to_owned(), limit: self.most_held });
            }
            if early || is_full {
                break;
            }
            self.next += 1;
            if let Err(error) = self.load(file, piece) {
                self.errors.push_back(error);
            }
        }
        match self.errors.pop_front() {
            Some(error) => Some(Err(error)),
            None => self.take(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{BagReader, BagWriter, WriterOptions};
    use catenary_msgs::geometry_msgs::msg::PoseStamped;
    use catenary_shell::Qos;

    #[test]
    fn chunks_that_overlap_by_more_than_memory_holds_are_one_error_and_lose_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bag");
        let options = WriterOptions { chunk_bytes: 3000, ..WriterOptions::default() };
        let mut bag = BagWriter::create(&path, &options).unwrap();
        let topic = bag.add_topic_of::<PoseStamped>("/pose", Qos::DEFAULT).unwrap();
        // Each chunk has messages of the whole recording.
        for i in 0..1000_i64 {
            bag.write(topic, i * 7919 % 1000, 0, &PoseStamped::default()).unwrap();
        }
        bag.finish().unwrap();
        let bag = BagReader::open(&path).unwrap();
        let times: Vec<i64> = bag.messages().map(|m| m.unwrap().log_time_ns).collect();
        assert!(times.len() == 1000 && times.is_sorted());
        let limited = bag.messages().with_most_held(20_000);
        let (good, bad): (Vec<_>, Vec<_>) = limited.partition(Result::is_ok);
        assert_eq!((good.len(), bad.len()), (1000, 1));
        let error = bad.into_iter().find_map(Result::err).unwrap().to_string();
        assert!(error.contains("overlap in log time to hold at most 20000 bytes"), "{error}");
    }
}
