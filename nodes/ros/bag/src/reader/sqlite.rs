//! Bag files in rosbag2's format before MCAP: sqlite3 databases.

use super::chunk::LARGEST;
use super::contents::{BagMessage, Topic};
use super::index::{IndexedFile, Piece, PieceKind};
use crate::error::BagError;
use crate::format::profile::{self, Profile};
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Numbers of rows and of bytes after which a piece ends: few enough for memory, and enough to make queries rare.
const ROWS: u64 = 256;
const BYTES: i64 = 1 << 20;

/// Opens a database read-only.
pub(super) fn connect(path: &Path) -> Result<Connection, BagError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    // Without the pragma, sqlite refuses a database that is shorter than its header states. The pragma writes nothing.
    let opened = Connection::open_with_flags(path, flags).and_then(|database| {
        database.pragma_update(None, "writable_schema", true)?;
        // A value that is computed when it is read may be larger than the file.
        database.set_limit(Limit::SQLITE_LIMIT_LENGTH, i32::try_from(LARGEST).unwrap_or(i32::MAX))?;
        Ok(database)
    });
    opened.map_err(|e| damaged(path, &e))
}

/// Checks that `name` is a table that holds its rows: a view or a virtual table may make rows without end.
fn check_table(database: &Connection, path: &Path, name: &str) -> Result<(), BagError> {
    let query = "SELECT type, sql FROM sqlite_master WHERE name = ?1";
    let found = database.query_row(query, [name], |row| Ok((row.get::<_, String>(0)?, row.get::<_, String>(1)?)));
    let found = found.optional().map_err(|e| damaged(path, &e))?;
    let is_table = |(kind, sql): &(String, String)| {
        let words: Vec<String> = sql.split_whitespace().take(2).map(str::to_lowercase).collect();
        kind == "table" && words == ["create", "table"]
    };
    match found {
        Some(found) if !is_table(&found) => {
            let reason = format!("expected a table `{name}`, found a {} that computes its rows", found.0);
            Err(BagError::Database { path: path.to_owned(), reason })
        }
        _ => Ok(()),
    }
}

fn damaged(path: &Path, error: &rusqlite::Error) -> BagError {
    BagError::Database { path: path.to_owned(), reason: error.to_string() }
}

/// Indexes a database, which errors name `path`.
pub(super) fn index(path: &Path, database: Connection) -> Result<IndexedFile, BagError> {
    for name in ["topics", "messages"] {
        check_table(&database, path, name)?;
    }
    let topics = topics(&database).map_err(|e| damaged(path, &e))?;
    let mut notes = Vec::new();
    let mut found = Found::default();
    // Rows are read in the order of the file: of a truncated file, everything before the cut is found.
    if let Err(error) = entries(&database, &topics, &mut found) {
        let all: u64 = found.counts.values().sum();
        notes.push(format!("{}: damaged: {all} messages were found: {error}", path.display()));
    }
    if found.unknown > 0 {
        let why = "because the database does not say their topic or time";
        notes.push(format!("{}: {} messages are left out, {why}", path.display(), found.unknown));
    }
    Ok(IndexedFile {
        path: path.to_owned(),
        source: path.to_owned(),
        _unpacked: None,
        pieces: found.pieces,
        channels: (0..).zip(topics.into_values()).collect(),
        counts: found.counts,
        notes,
        // A database has no end that could be added.
        is_finished: true,
        database: Some(Mutex::new(database)),
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

/// Messages of a database: their places, and their numbers by channel.
#[derive(Default)]
struct Found {
    pieces: Vec<Piece>,
    counts: BTreeMap<u16, u64>,
    /// Number of messages of unknown topic or time.
    unknown: u64,
}

/// Channels by the ids of their topics.
fn channels(ids: impl Iterator<Item = i64>) -> BTreeMap<i64, u16> {
    ids.zip(0..).collect()
}

/// Finds the places of the messages, piece by piece, in the order of their keys.
fn entries(database: &Connection, topics: &BTreeMap<i64, Arc<Topic>>, found: &mut Found) -> rusqlite::Result<()> {
    let channels = channels(topics.keys().copied());
    // NOT INDEXED: the index on timestamps lies elsewhere in the file, and may be lost with its end.
    let query = "SELECT id, topic_id, timestamp, length(data) FROM messages NOT INDEXED ORDER BY id";
    let mut statement = database.prepare(query)?;
    let mut rows = statement.query([])?;
    // Numbers of rows and bytes of the last piece.
    let (mut count, mut bytes) = (0, 0);
    while let Some(row) = rows.next()? {
        let channel = row.get(1).ok().and_then(|id: i64| channels.get(&id));
        let (Some(channel), Ok(time)) = (channel, row.get::<_, i64>(2)) else {
            found.unknown += 1;
            continue;
        };
        let id: i64 = row.get(0)?;
        *found.counts.entry(*channel).or_default() += 1;
        (count, bytes) = (count + 1, bytes + row.get::<_, i64>(3).unwrap_or(0));
        match found.pieces.last_mut().filter(|_| count <= ROWS && bytes <= BYTES) {
            Some(piece) => {
                piece.len = id.wrapping_sub(piece.offset.cast_signed()).cast_unsigned();
                piece.span = (piece.span.0.min(time), piece.span.1.max(time));
            }
            None => {
                (count, bytes) = (1, row.get::<_, i64>(3).unwrap_or(0));
                let (span, offset) = ((time, time), id.cast_unsigned());
                found.pieces.push(Piece { span, offset, len: 0, kind: PieceKind::Rows, channels: None });
            }
        }
    }
    Ok(())
}

/// Open database of a file.
fn open(file: &IndexedFile) -> Result<MutexGuard<'_, Connection>, String> {
    let database = file.database.as_ref().ok_or_else(|| "no open database".to_owned())?;
    Ok(database.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Row of a message: its key, channel and log time.
struct MessageRow {
    id: i64,
    channel: u16,
    time: i64,
}

/// Rows of a piece in the order of their keys, as far as they can be read.
fn rows(file: &IndexedFile, database: &Connection, piece: &Piece) -> Result<Vec<MessageRow>, String> {
    let text = |e: rusqlite::Error| e.to_string();
    let ids = topic_ids(database).map_err(text)?;
    let channels = channels(ids.into_iter());
    let query = "SELECT id, topic_id, timestamp FROM messages NOT INDEXED WHERE id BETWEEN ?1 AND ?2 ORDER BY id";
    let mut statement = database.prepare_cached(query).map_err(text)?;
    let first = piece.offset.cast_signed();
    let mut rows = statement.query([first, first.wrapping_add(piece.len.cast_signed())]).map_err(text)?;
    let mut found = Vec::new();
    // Damage in this part of the file was noted when it was indexed.
    while let Ok(Some(row)) = rows.next() {
        let channel = row.get(1).ok().and_then(|id: i64| channels.get(&id)).copied();
        if let (Ok(id), Some(channel), Ok(time)) = (row.get(0), channel, row.get(2))
            && file.channels.contains_key(&channel)
        {
            found.push(MessageRow { id, channel, time });
        }
    }
    Ok(found)
}

/// Ids of the topics; one that comes twice counts once, as in the index.
fn topic_ids(database: &Connection) -> rusqlite::Result<BTreeSet<i64>> {
    let mut statement = database.prepare_cached("SELECT id FROM topics ORDER BY id")?;
    statement.query_map([], |row| row.get(0))?.collect()
}

/// Calls `visit` with channel and log time of every message of a piece.
pub(super) fn times(file: &IndexedFile, piece: &Piece, mut visit: impl FnMut(u16, i128)) -> Result<(), String> {
    rows(file, &*open(file)?, piece)?.iter().for_each(|row| visit(row.channel, i128::from(row.time)));
    Ok(())
}

/// Reads the messages of a piece and passes each to `take` with its index in the piece. The error is that of the first
/// unreadable message.
pub(super) fn read(file: &IndexedFile, piece: &Piece, mut take: impl FnMut(usize, BagMessage)) -> Result<(), String> {
    let database = open(file)?;
    let rows = rows(file, &database, piece)?;
    let mut statement =
        database.prepare_cached("SELECT data FROM messages WHERE id = ?1").map_err(|e| e.to_string())?;
    let mut outcome = Ok(());
    for (place, entry) in rows.iter().enumerate() {
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
