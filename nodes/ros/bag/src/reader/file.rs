//! Opening of a bag file: its kind, and its index by summary, scan or database.

use super::chunk::{LARGEST, RECORD_HEADER};
use super::index::{Definitions, IndexedFile, Piece, PieceKind, nanoseconds};
use super::scan::scan;
use super::scratch::unpack;
use super::sqlite;
use super::zstd_data::ZSTD_MAGIC;
use crate::error::BagError;
use mcap::MAGIC;
use mcap::records::{ChunkIndex, Record, Statistics, op};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Indexes a file.
pub(super) fn open(path: &Path) -> Result<IndexedFile, BagError> {
    match kind_of(path, path)? {
        Kind::Mcap => open_mcap(path, path),
        Kind::Sqlite => sqlite::index(path, sqlite::connect(path)?),
        Kind::Zstd => {
            let unpacked = unpack(path)?;
            let source = unpacked.path();
            let file = match kind_of(path, &source)? {
                Kind::Mcap => open_mcap(path, &source)?,
                Kind::Sqlite => sqlite::index(path, unpacked.named(path, sqlite::connect)?)?,
                Kind::Zstd => return Err(BagError::NotABag { path: path.to_owned(), found: TWICE.to_owned() }),
            };
            // The decompressed copy is a scratch file: finishing it would not change the file.
            Ok(IndexedFile { _unpacked: Some(unpacked), is_finished: true, ..file })
        }
    }
}

/// Indexes an MCAP file by its summary, or record by record if it has none.
fn open_mcap(path: &Path, source: &Path) -> Result<IndexedFile, BagError> {
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
    Ok(IndexedFile {
        path: path.to_owned(),
        source: source.to_owned(),
        _unpacked: None,
        pieces: definitions.pieces,
        channels: definitions.channels,
        counts: definitions.counts,
        notes: definitions.notes.into_iter().map(|n| format!("{}: {n}", path.display())).collect(),
        is_finished: definitions.is_finished,
        database: None,
    })
}

/// Kind of a file by its first bytes.
enum Kind {
    Mcap,
    Sqlite,
    /// File that was compressed as a whole.
    Zstd,
}

/// Description of a file that was compressed twice.
const TWICE: &str = "a compressed file within a compressed file";

/// Determines the kind of the bag file at `source`, which errors name `path`. The error describes a file that is none.
fn kind_of(path: &Path, source: &Path) -> Result<Kind, BagError> {
    let file = File::open(source).map_err(BagError::io("open", path))?;
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

/// Definitions of the summary of a finished file; none if there is no complete summary.
fn summary(file: &mut File, len: u64) -> std::io::Result<Option<Definitions>> {
    // The footer's body has 20 bytes, and the magic behind it 8.
    const FOOTER: u64 = RECORD_HEADER + 20 + 8;
    let Some(footer_start) = len.checked_sub(FOOTER) else { return Ok(None) };
    file.seek(SeekFrom::Start(footer_start))?;
    let mut end = [0; FOOTER as usize];
    file.read_exact(&mut end)?;
    let footer = mcap::parse_record(op::FOOTER, &end[RECORD_HEADER as usize..29]);
    let Ok(Record::Footer(footer)) = footer else { return Ok(None) };
    let whole = end[0] == op::FOOTER && &end[29..] == MAGIC;
    // A start of 0 means that the file has no summary.
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
    // The writer of a summary may leave parts out: it is used only if its numbers agree with its statistics.
    let chunks = definitions.pieces.len() as u64 == u64::from(statistics.chunk_count);
    let indexed = statistics.message_count == 0 || !definitions.pieces.is_empty();
    let counted: u64 = statistics.channel_message_counts.values().sum();
    let known = statistics.channel_message_counts.keys().all(|id| definitions.channels.contains_key(id));
    // A chunk of definitions alone has the times 0, which lie before the first message.
    definitions.pieces.retain(|p| p.span.1 >= nanoseconds(statistics.message_start_time));
    definitions.counts = statistics.channel_message_counts;
    (chunks && indexed && known && counted == statistics.message_count).then_some(definitions)
}

fn chunk_piece(index: &ChunkIndex, data_end: u64) -> Option<Piece> {
    let end = index.chunk_start_offset.checked_add(index.chunk_length)?;
    let len = index.chunk_length.checked_sub(RECORD_HEADER)?;
    let span = (nanoseconds(index.message_start_time), nanoseconds(index.message_end_time));
    // A writer may leave the message indexes out.
    let channels =
        (!index.message_index_offsets.is_empty()).then(|| index.message_index_offsets.keys().copied().collect());
    (end <= data_end).then_some(Piece { span, offset: index.chunk_start_offset, len, kind: PieceKind::Chunk, channels })
}
