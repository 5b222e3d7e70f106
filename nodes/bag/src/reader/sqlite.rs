//! Bags in rosbag2's format before MCAP: one sqlite3 database for each file.

use super::file::{IndexedFile, Piece, Place};
use super::{BagMessage, Topic};
use crate::error::BagError;
use crate::profile::{self, Profile};
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Rows that are read at once.
const ROWS: usize = 256;

/// Where a message is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// Log time in ns; negative before 1970, as of a clock that was never set.
    time: i64,
    id: i64,
    channel: u16,
}

/// Opens a database for reading alone.
pub(super) fn connect(path: &Path) -> Result<Connection, BagError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    // Without the pragma a database that is shorter than it says is not read at all. Nothing is written by it.
    let opened = Connection::open_with_flags(path, flags)
        .and_then(|database| database.pragma_update(None, "writable_schema", true).map(|()| database));
    opened.map_err(|e| damaged(path, &e))
}

fn damaged(path: &Path, error: &rusqlite::Error) -> BagError {
    BagError::Database { path: path.to_owned(), reason: error.to_string() }
}

/// Looks through the database at `source`, which is called `path` in messages.
pub(super) fn index(path: &Path, source: &Path) -> Result<IndexedFile, BagError> {
    let database = connect(source)?;
    let topics = topics(&database).map_err(|e| damaged(path, &e))?;
    let mut notes = Vec::new();
    let mut rows = Vec::new();
    // In the order of the file, so that of one that was cut off everything before the cut is found.
    let mut unknown = 0_u64;
    if let Err(error) = entries(&database, &topics, &mut rows, &mut unknown) {
        notes.push(format!("{}: damaged: {} messages were found: {error}", path.display(), rows.len()));
    }
    if unknown > 0 {
        let why = "because the database does not say their topic or time";
        notes.push(format!("{}: {unknown} messages are left out, {why}", path.display()));
    }
    rows.sort_by_key(|entry| (entry.time, entry.id));
    let piece = |(i, rows): (usize, &[Entry])| {
        let span = (rows.first()?.time, rows.last()?.time);
        Some(Piece { span, offset: (i * ROWS) as u64, len: rows.len() as u64, place: Place::Rows })
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
        // Nothing can be done about one that is not.
        is_finished: true,
        rows,
    })
}

/// The topics by their numbers in the database.
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

/// Finds where the messages are, and counts those whose topic or time is `unknown`.
fn entries(
    database: &Connection,
    topics: &BTreeMap<i64, Arc<Topic>>,
    found: &mut Vec<Entry>,
    unknown: &mut u64,
) -> rusqlite::Result<()> {
    let channels: BTreeMap<i64, u16> = topics.keys().copied().zip(0..).collect();
    let mut statement = database.prepare("SELECT id, topic_id, timestamp FROM messages NOT INDEXED ORDER BY id")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let channel = row.get(1).ok().and_then(|id: i64| channels.get(&id));
        match (channel, row.get::<_, i64>(2)) {
            (Some(channel), Ok(time)) => {
                found.push(Entry { time, id: row.get(0)?, channel: *channel });
            }
            _ => *unknown += 1,
        }
    }
    Ok(())
}

/// The messages of a piece, with their places in it. The error is that of the first that cannot be read.
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

#[cfg(test)]
mod tests {
    use crate::reader::BagReader;
    use rusqlite::Connection;

    /// A bag of one database with the `rows` (topic_id, timestamp).
    fn bag_of(folder: &std::path::Path, rows: &[&str]) -> BagReader {
        let path = folder.join("bag.db3");
        let database = Connection::open(&path).unwrap();
        let topics = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)";
        database.execute(topics, []).unwrap();
        database.execute("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/Int32', 'cdr')", []).unwrap();
        database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data BLOB)", []).unwrap();
        for row in rows {
            database
                .execute(&format!("INSERT INTO messages(topic_id, timestamp, data) VALUES ({row}, x'00')"), [])
                .unwrap();
        }
        drop(database);
        BagReader::open(&path).unwrap()
    }

    #[test]
    fn times_before_1970_keep_their_order_and_their_span() {
        let folder = tempfile::tempdir().unwrap();
        let bag = bag_of(folder.path(), &["1, -5000000000", "1, 7", "1, -9000000000", "1, -1"]);
        assert_eq!(bag.span_ns(), Some((-9_000_000_000, 7)));
        let times: Vec<i64> = bag.messages().map(|m| m.unwrap().log_time_ns).collect();
        assert_eq!(times, [-9_000_000_000, -5_000_000_000, -1, 7]);
    }

    #[test]
    fn rows_of_no_topic_are_counted_and_end_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let bag = bag_of(folder.path(), &["1, 10", "7, 11", "NULL, 12", "'x', 13", "1, NULL", "1, 15"]);
        assert_eq!((bag.message_count(), bag.span_ns(), bag.verify()), (2, Some((10, 15)), (2, Vec::new())));
        assert_eq!(bag.notes().len(), 1, "{:?}", bag.notes());
        assert!(bag.notes()[0].contains("4 messages are left out"), "{:?}", bag.notes());
    }
}
