//! Index of one file of a bag: its topics, and the places of its messages.

use super::chunk::{LARGEST, RECORD_HEADER};
use super::contents::{Topic, TopicCount};
use super::scratch::Scratch;
use crate::format::metadata::joined;
use crate::format::profile::{self, Profile};
use mcap::records::{Channel, Record};
use rusqlite::Connection;
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// Kind of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PieceKind {
    Chunk,
    /// Messages outside of chunks, one behind the other.
    Run,
    /// Rows of a database.
    Rows,
}

/// Part of a file whose messages are read together.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    /// Earliest and latest log time in ns, without those far from the recording.
    pub(crate) span: (i64, i64),
    /// Byte offset of its first record; for a database, the key of its first row.
    pub(crate) offset: u64,
    /// Length in bytes of a chunk's body, or of all records of a run; for a database, the distance from the first key to the
    /// last one.
    pub(crate) len: u64,
    pub(crate) kind: PieceKind,
    /// Channels of its messages; none if the index does not say them.
    pub(crate) channels: Option<Arc<[u16]>>,
}

/// Indexed file.
#[derive(Debug)]
pub(crate) struct IndexedFile {
    pub(crate) path: PathBuf,
    /// File that is read: the file itself, or the scratch file with its decompressed content.
    pub(crate) source: PathBuf,
    /// Keeps the scratch file open.
    pub(crate) _unpacked: Option<Scratch>,
    pub(crate) pieces: Vec<Piece>,
    pub(crate) channels: BTreeMap<u16, Arc<Topic>>,
    pub(crate) counts: BTreeMap<u16, u64>,
    /// Sentences about missing or damaged parts.
    pub(crate) notes: Vec<String>,
    /// True if nothing is missing at its end.
    pub(crate) is_finished: bool,
    /// Open database; none for MCAP.
    pub(crate) database: Option<Mutex<Connection>>,
}

impl IndexedFile {
    pub(crate) fn messages(&self) -> u64 {
        self.counts.values().sum()
    }

    /// First and last log time in ns.
    pub(crate) fn span_ns(&self) -> Option<(i64, i64)> {
        joined(self.pieces.iter().map(|p| Some(p.span)))
    }

    /// Topics with the number of their messages.
    pub(crate) fn topics(&self) -> impl Iterator<Item = TopicCount> {
        let count = |id: &u16| self.counts.get(id).copied().unwrap_or(0);
        self.channels.iter().map(move |(id, topic)| TopicCount { topic: Arc::clone(topic), messages: count(id) })
    }
}

/// Definitions and pieces that the records of a file give.
#[derive(Debug, Default)]
pub(crate) struct Definitions {
    pub(super) schemas: BTreeMap<u16, String>,
    pub(crate) channels: BTreeMap<u16, Arc<Topic>>,
    pub(crate) counts: BTreeMap<u16, u64>,
    pub(crate) pieces: Vec<Piece>,
    pub(crate) notes: Vec<String>,
    /// True if nothing is missing at the end of the file.
    pub(crate) is_finished: bool,
    /// Compression of a chunk that cannot be read.
    pub(super) foreign_compression: Option<String>,
}

impl Definitions {
    /// Adds a schema or a channel. The first record of an id counts; the format demands that all are equal.
    pub(crate) fn define(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.entry(header.id).or_insert(header.name);
            }
            Record::Channel(channel) if !self.channels.contains_key(&channel.id) => {
                let type_name = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                self.channels.insert(channel.id, Arc::new(topic(channel, type_name)));
            }
            _ => {}
        }
    }

    pub(crate) fn check_compression(&mut self, compression: &str) {
        if !matches!(compression, "" | "zstd" | "lz4") {
            self.foreign_compression = Some(compression.to_owned());
        }
    }
}

fn topic(mut channel: Channel, type_name: String) -> Topic {
    let mut take = |key: &str| channel.metadata.remove(key).unwrap_or_default();
    let (hash, profiles) = (take("topic_type_hash"), profile::parse(&take("offered_qos_profiles")));
    Topic {
        name: channel.topic,
        type_name,
        encoding: channel.message_encoding,
        // Middleware without type hashes writes an invalid one.
        type_hash: hash.starts_with("RIHS01_").then_some(hash),
        qos: profiles.iter().map(Profile::qos).collect(),
        profiles,
    }
}

/// Converts an MCAP log time, which is unsigned, to ns; times after the year 2262 become the greatest i64.
pub(crate) fn nanoseconds(time: u64) -> i64 {
    i64::try_from(time).unwrap_or(i64::MAX)
}

/// Reads the records of a run of messages. Its length must lie within the file.
pub(crate) fn read_run(mut file: impl Read + Seek, run: &Piece) -> std::io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(run.offset))?;
    let mut records = vec![0; usize::try_from(run.len).unwrap_or(usize::MAX)];
    file.read_exact(&mut records)?;
    Ok(records)
}

/// Reads the body of the record at `offset`. Its length must lie within the file.
pub(crate) fn read_body(mut file: impl Read + Seek, offset: u64, len: u64) -> std::io::Result<Vec<u8>> {
    if len > LARGEST {
        return Err(std::io::Error::other(format!("expected a record of at most {LARGEST} bytes, got one of {len}")));
    }
    file.seek(SeekFrom::Start(offset + RECORD_HEADER))?;
    let mut body = vec![0; usize::try_from(len).unwrap_or(usize::MAX)];
    file.read_exact(&mut body)?;
    Ok(body)
}
