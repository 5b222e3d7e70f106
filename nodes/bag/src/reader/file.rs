//! One file of a bag: which topics it has, and where its messages lie.

use super::chunk::{LARGEST, RECORD_HEADER};
use super::messages::ZSTD_MAGIC;
use super::scan::scan;
use super::{Topic, TopicCount, sqlite};
use crate::error::BagError;
use crate::metadata::joined;
use crate::profile::{self, Profile};
use mcap::MAGIC;
use mcap::records::{Channel, ChunkIndex, Record, Statistics, op};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempPath;

/// What a piece is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Chunk,
    /// A message that stands alone.
    Message,
    /// Messages of a database.
    Rows,
}

/// Messages that are read at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// Earliest and latest log time in ns.
    pub(super) span: (i64, i64),
    /// Where its record begins; of a database: the number of its first message.
    pub(super) offset: u64,
    /// Bytes of the record's body; of a database: messages.
    pub(super) len: u64,
    pub(super) place: Place,
}

/// A file that was looked through.
#[derive(Debug)]
pub(super) struct IndexedFile {
    pub(super) path: PathBuf,
    /// What is read: the file, or what was unpacked from it.
    pub(super) source: PathBuf,
    /// Deletes what was unpacked.
    pub(super) _unpacked: Option<TempPath>,
    pub(super) pieces: Vec<Piece>,
    pub(super) channels: BTreeMap<u16, Arc<Topic>>,
    pub(super) counts: BTreeMap<u16, u64>,
    /// What is missing or damaged.
    pub(super) notes: Vec<String>,
    /// Whether nothing is missing at its end.
    pub(super) is_finished: bool,
    /// Of a database: where each message is, by time.
    pub(super) rows: Vec<sqlite::Entry>,
}

impl IndexedFile {
    /// Looks a file through.
    pub(super) fn open(path: &Path) -> Result<Self, BagError> {
        match kind_of(path)? {
            Kind::Mcap => Self::open_mcap(path, path),
            Kind::Sqlite => sqlite::index(path, path),
            Kind::Zstd => {
                let unpacked = unpack(path).map_err(BagError::io("unpack", path))?;
                let file = match kind_of(&unpacked)? {
                    Kind::Mcap => Self::open_mcap(path, &unpacked)?,
                    Kind::Sqlite => sqlite::index(path, &unpacked)?,
                    Kind::Zstd => return Err(BagError::NotABag { path: path.to_owned(), found: TWICE.to_owned() }),
                };
                // What was unpacked can be finished as little as any other copy.
                Ok(Self { _unpacked: Some(unpacked), is_finished: true, ..file })
            }
        }
    }

    /// Looks an MCAP file through: by its summary where it has one, else record by record.
    fn open_mcap(path: &Path, source: &Path) -> Result<Self, BagError> {
        let mut file = File::open(source).map_err(BagError::io("open", path))?;
        let len = file.metadata().map_err(BagError::io("open", path))?.len();
        let summary = summary(&mut file, len).map_err(BagError::io("read", path))?;
        let definitions = match summary {
            Some(summary) => Definitions { is_finished: true, ..summary },
            None => scan(&file, len).map_err(BagError::io("read", path))?,
        };
        if let Some(name) = definitions.foreign_compression {
            return Err(BagError::Unsupported {
                path: path.to_owned(),
                found: format!("chunks compressed by {name:?} are"),
                remedy: "`mcap compress --compression zstd` makes a file that is read here",
            });
        }
        Ok(Self {
            path: path.to_owned(),
            source: source.to_owned(),
            _unpacked: None,
            pieces: definitions.pieces,
            channels: definitions.channels,
            counts: definitions.counts,
            notes: definitions.notes.into_iter().map(|n| format!("{}: {n}", path.display())).collect(),
            is_finished: definitions.is_finished,
            rows: Vec::new(),
        })
    }

    pub(super) fn messages(&self) -> u64 {
        self.counts.values().sum()
    }

    /// First and last log time in ns.
    pub(super) fn span_ns(&self) -> Option<(i64, i64)> {
        joined(self.pieces.iter().map(|p| Some(p.span)))
    }

    /// Topics with the number of their messages.
    pub(super) fn topics(&self) -> impl Iterator<Item = TopicCount> {
        let count = |id: &u16| self.counts.get(id).copied().unwrap_or(0);
        self.channels.iter().map(move |(id, topic)| TopicCount { topic: Arc::clone(topic), messages: count(id) })
    }
}

/// What a file is by its first bytes.
enum Kind {
    Mcap,
    Sqlite,
    /// A file that was compressed as a whole.
    Zstd,
}

/// What is found in a file that was compressed twice.
const TWICE: &str = "a compressed file within a compressed file";

/// Says what kind of bag a file is, and what it is where it is none.
fn kind_of(path: &Path) -> Result<Kind, BagError> {
    let file = File::open(path).map_err(BagError::io("open", path))?;
    let len = file.metadata().map_err(BagError::io("open", path))?.len();
    let mut start = Vec::new();
    file.take(16).read_to_end(&mut start).map_err(BagError::io("read", path))?;
    if start.starts_with(MAGIC) {
        return Ok(Kind::Mcap);
    }
    if start.starts_with(b"SQLite format 3") {
        return Ok(Kind::Sqlite);
    }
    if start.starts_with(&ZSTD_MAGIC) {
        return Ok(Kind::Zstd);
    }
    if start.starts_with(b"#ROSBAG V") {
        return Err(BagError::Unsupported {
            path: path.to_owned(),
            found: "bags of ROS 1 are".to_owned(),
            remedy: "`rosbags-convert` of the Python package rosbags makes a bag of ROS 2 from one",
        });
    }
    let found = match len {
        0 => "an empty file".to_owned(),
        _ => format!("a file of {len} bytes that begins neither as an MCAP file nor as a database of sqlite3"),
    };
    Err(BagError::NotABag { path: path.to_owned(), found })
}

/// Unpacks a file into a temporary one. Of a file that was cut off comes what can be had.
fn unpack(path: &Path) -> std::io::Result<TempPath> {
    let mut packed = zstd::Decoder::new(File::open(path)?)?;
    let mut unpacked = tempfile::NamedTempFile::new()?;
    let copied = std::io::copy(&mut packed, &mut unpacked);
    match copied {
        Err(error) if unpacked.as_file().metadata()?.len() == 0 => Err(error),
        Err(error) if error.kind() == std::io::ErrorKind::StorageFull => Err(error),
        _ => Ok(unpacked.into_temp_path()),
    }
}

/// What the records of a file define.
#[derive(Debug, Default)]
pub(super) struct Definitions {
    schemas: BTreeMap<u16, String>,
    pub(super) channels: BTreeMap<u16, Arc<Topic>>,
    pub(super) counts: BTreeMap<u16, u64>,
    pub(super) pieces: Vec<Piece>,
    pub(super) notes: Vec<String>,
    /// Whether nothing is missing at the end of the file.
    pub(super) is_finished: bool,
    foreign_compression: Option<String>,
}

impl Definitions {
    /// Takes a schema or a channel; the first of a number counts, as the format demands that all are equal.
    pub(super) fn define(&mut self, record: Record<'_>) {
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

    pub(super) fn check_compression(&mut self, compression: &str) {
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
        // Middleware that announces no hashes leaves an invalid one behind.
        type_hash: hash.starts_with("RIHS01_").then_some(hash),
        qos: profiles.iter().map(Profile::qos).collect(),
        profiles,
    }
}

/// A log time of MCAP, which has no negative ones; beyond the year 2262 the greatest that an i64 can hold.
pub(super) fn nanoseconds(time: u64) -> i64 {
    i64::try_from(time).unwrap_or(i64::MAX)
}

/// Body of the record at `offset`; its length is known to lie within the file.
pub(super) fn read_body(mut file: impl Read + Seek, offset: u64, len: u64) -> std::io::Result<Vec<u8>> {
    if len > LARGEST {
        return Err(std::io::Error::other(format!("expected a record of at most {LARGEST} bytes, got one of {len}")));
    }
    file.seek(SeekFrom::Start(offset + RECORD_HEADER))?;
    let mut body = vec![0; usize::try_from(len).unwrap_or(usize::MAX)];
    file.read_exact(&mut body)?;
    Ok(body)
}

/// What the summary of a finished file defines; none where there is no summary that says where all messages are.
fn summary(file: &mut File, len: u64) -> std::io::Result<Option<Definitions>> {
    const FOOTER: u64 = RECORD_HEADER + 20 + 8;
    let Some(footer_start) = len.checked_sub(FOOTER) else { return Ok(None) };
    file.seek(SeekFrom::Start(footer_start))?;
    let mut end = [0; FOOTER as usize];
    file.read_exact(&mut end)?;
    let footer = mcap::parse_record(op::FOOTER, &end[RECORD_HEADER as usize..29]);
    let Ok(Record::Footer(footer)) = footer else { return Ok(None) };
    let whole = end[0] == op::FOOTER && &end[29..] == MAGIC;
    let section = footer_start.checked_sub(footer.summary_start).filter(|s| *s <= LARGEST);
    let (true, Some(section)) = (whole && footer.summary_start > 0, section) else { return Ok(None) };
    file.seek(SeekFrom::Start(footer.summary_start))?;
    let mut bytes = vec![0; usize::try_from(section).unwrap_or_default()];
    file.read_exact(&mut bytes)?;
    Ok(read_summary(&bytes, footer.summary_start))
}

fn read_summary(mut bytes: &[u8], data_end: u64) -> Option<Definitions> {
    let mut definitions = Definitions::default();
    let mut statistics: Option<Statistics> = None;
    while let Some((head, rest)) = bytes.split_at_checked(RECORD_HEADER as usize) {
        let len = u64::from_le_bytes(head[1..].try_into().ok()?);
        let (body, later) = rest.split_at_checked(usize::try_from(len).ok()?)?;
        bytes = later;
        match head[0] {
            op::SCHEMA | op::CHANNEL => definitions.define(mcap::parse_record(head[0], body).ok()?),
            op::STATISTICS => match mcap::parse_record(head[0], body).ok()? {
                Record::Statistics(s) => statistics = Some(s),
                _ => return None,
            },
            op::CHUNK_INDEX => match mcap::parse_record(head[0], body).ok()? {
                Record::ChunkIndex(index) => {
                    definitions.check_compression(&index.compression);
                    definitions.pieces.push(chunk_piece(&index, data_end)?);
                }
                _ => return None,
            },
            _ => {}
        }
    }
    let statistics = statistics?;
    let chunks = definitions.pieces.len() as u64 == u64::from(statistics.chunk_count);
    let indexed = statistics.message_count == 0 || !definitions.pieces.is_empty();
    let counted: u64 = statistics.channel_message_counts.values().sum();
    let known = statistics.channel_message_counts.keys().all(|id| definitions.channels.contains_key(id));
    // A chunk that holds definitions alone has no times.
    definitions.pieces.retain(|p| p.span.1 >= nanoseconds(statistics.message_start_time));
    definitions.counts = statistics.channel_message_counts;
    (chunks && indexed && known && counted == statistics.message_count).then_some(definitions)
}

fn chunk_piece(index: &ChunkIndex, data_end: u64) -> Option<Piece> {
    let end = index.chunk_start_offset.checked_add(index.chunk_length)?;
    let len = index.chunk_length.checked_sub(RECORD_HEADER)?;
    let span = (nanoseconds(index.message_start_time), nanoseconds(index.message_end_time));
    (end <= data_end).then_some(Piece { span, offset: index.chunk_start_offset, len, place: Place::Chunk })
}
