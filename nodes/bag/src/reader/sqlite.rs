//! Bag files in rosbag2's format before MCAP: sqlite3 databases.

use super::contents::{BagMessage, Topic};
use super::index::{IndexedFile, MessageRow, Piece, PieceKind};
use crate::error::BagError;
use crate::format::profile::{self, Profile};
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Number of rows of a piece: few enough for memory, and enough to make queries rare.
const ROWS: usize = 256;

/// Opens a database read-only.
pub(super) fn connect(path: &Path) -> Result<Connection, BagError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    // Without the pragma, sqlite refuses a database that is shorter than its header states. The pragma writes nothing.
    let opened = Connection::open_with_flags(path, flags)
        .and_then(|database| database.pragma_update(None, "writable_schema", true).map(|()| database));
    opened.map_err(|e| damaged(path, &e))
}

fn damaged(path: &Path, error: &rusqlite::Error) -> BagError {
    BagError::Database { path: path.to_owned(), reason: error.to_string() }
}

/// Indexes the database at `source`. Messages name it `path`.
pub(super) fn index(path: &Path, source: &Path) -> Result<IndexedFile, BagError> {
    let database = connect(source)?;
    let topics = topics(&database).map_err(|e| damaged(path, &e))?;
    let mut notes = Vec::new();
    let mut rows = Vec::new();
    // Rows are read in the order of the file: of a truncated file, everything before the cut is found.
    let mut unknown = 0_u64;
    if let Err(error) = entries(&database, &topics, &mut rows, &mut unknown) {
        notes.push(format!("{}: damaged: {} messages were found: {error}", path.display(), rows.len()));
    }
    if unknown > 0 {
        let why = "because the database does not say their topic or time";
        notes.push(format!("{}: {unknown} messages are left out, {why}", path.display()));
    }
    rows.sort_by_key(|entry| (entry.time, entry.id));
    let piece = |(i, rows): (usize, &[MessageRow])| {
        let span = (rows.first()?.time, rows.last()?.time);
        Some(Piece { span, offset: (i * ROWS) as u64, len: rows.len() as u64, kind: PieceKind::Rows })
    };
    let mut counts = BTreeMap::new();
    rows.iter().for_each(|entry| *counts.entry(entry.channel).or_default() += 1);
    Ok(IndexedFile {
        path: path.to_owned(),
        source: source.to_owned(),
        _unpacked: None,
        pieces: rows.chunks(ROWS).enumerate().filter_map(piece).collect(),
        channels: (0..).zip(topics.into_values()).collect(),
        counts,
        notes,
        // A database has no end that could be added.
        is_finished: true,
        rows,
    })
}

/// Topics by their ids in the database.
fn topics(database: &Connection) -> rusqlite::Result<BTreeMap<i64, Arc<Topic>>> {
    let mut statement = database.prepare("SELECT * FROM topics")?;
    // Older recorders wrote neither profiles nor hashes.
    let optional = |row: &Row<'_>, column: &str| row.get::<_, String>(column).unwrap_or_default();
    let topic = |row: &Row<'_>| {
        let hash = optional(row, "type_description_hash");
        let profiles = profile::parse(&optional(row, "offered_qos_profiles"));
        let topic = Topic {
            name: row.get("name")?,
            type_name: row.get("type")?,
            encoding: row.get("serialization_format")?,
            type_hash: hash.starts_with("RIHS01_").then_some(hash),
            qos: profiles.iter().map(Profile::qos).collect(),
            profiles,
        };
        Ok((row.get("id")?, Arc::new(topic)))
    };
    statement.query_map([], topic)?.collect()
}

/// Finds the places of the messages, and counts messages of `unknown` topic or time.
fn entries(
    database: &Connection,
    topics: &BTreeMap<i64, Arc<Topic>>,
    found: &mut Vec<MessageRow>,
    unknown: &mut u64,
) -> rusqlite::Result<()> {
    let channels: BTreeMap<i64, u16> = topics.keys().copied().zip(0..).collect();
    // NOT INDEXED: the index on timestamps lies elsewhere in the file, and may be lost with its end.
    let mut statement = database.prepare("SELECT id, topic_id, timestamp FROM messages NOT INDEXED ORDER BY id")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let channel = row.get(1).ok().and_then(|id: i64| channels.get(&id));
        match (channel, row.get::<_, i64>(2)) {
            (Some(channel), Ok(time)) => {
                found.push(MessageRow { time, id: row.get(0)?, channel: *channel });
            }
            _ => *unknown += 1,
        }
    }
    Ok(())
}

/// Reads the messages of a piece and passes each to `take` with its index in the piece. The error is that of the first
/// unreadable message.
pub(super) fn read(
    file: &IndexedFile,
    database: &Connection,
    piece: &Piece,
    mut take: impl FnMut(usize, BagMessage),
) -> Result<(), String> {
    let first = usize::try_from(piece.offset).unwrap_or(usize::MAX);
    let rows = file.rows.iter().skip(first).take(usize::try_from(piece.len).unwrap_or(usize::MAX));
    let mut statement =
        database.prepare_cached("SELECT data FROM messages WHERE id = ?1").map_err(|e| e.to_string())?;
    let mut outcome = Ok(());
    for (place, entry) in rows.enumerate() {
        let data = statement.query_row([entry.id], |row| row.get::<_, Vec<u8>>(0)).optional();
        let time = entry.time;
        match (data, file.channels.get(&entry.channel)) {
            (Ok(Some(data)), Some(topic)) => {
                let topic = Arc::clone(topic);
                take(place, BagMessage { topic, log_time_ns: time, publish_time_ns: time, data });
            }
            (Err(error), _) if outcome.is_ok() => outcome = Err(error.to_string()),
            _ => {}
        }
    }
    outcome
}
