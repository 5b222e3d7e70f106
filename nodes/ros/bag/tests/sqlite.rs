//! Bags in sqlite3 with rows that no recorder should write: times before 1970, and rows without a topic.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test of files reads files")]

use catenary_bag::BagReader;
use rusqlite::Connection;

/// Bag of one database with the `rows` (topic_id, timestamp).
fn bag_of(folder: &std::path::Path, rows: &[&str]) -> BagReader {
    let path = folder.join("bag.db3");
    let database = Connection::open(&path).unwrap();
    let topics = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)";
    database.execute(topics, []).unwrap();
    database.execute("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/Int32', 'cdr')", []).unwrap();
    database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data BLOB)", []).unwrap();
    // One transaction: a commit of each row would wait for the disk.
    database.execute_batch("BEGIN").unwrap();
    for row in rows {
        database
            .execute(&format!("INSERT INTO messages(topic_id, timestamp, data) VALUES ({row}, x'00')"), [])
            .unwrap();
    }
    database.execute_batch("COMMIT").unwrap();
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
    assert_eq!((bag.message_count(), bag.span_ns(), bag.verify().readable), (2, Some((10, 15)), 2));
    assert_eq!(bag.verify().damaged, 0);
    assert_eq!(bag.notes().len(), 1, "{:?}", bag.notes());
    assert!(bag.notes()[0].contains("4 messages are left out"), "{:?}", bag.notes());
}

#[test]
fn a_database_that_was_compressed_as_a_whole_is_read_from_a_scratch_file() {
    let folder = tempfile::tempdir().unwrap();
    let rows: Vec<String> = (0..1000).map(|i| format!("1, {}", 1000 - i)).collect();
    let plain = bag_of(folder.path(), &rows.iter().map(String::as_str).collect::<Vec<_>>());
    let known: Vec<i64> = plain.messages().map(|m| m.unwrap().log_time_ns).collect();
    assert!(known.len() == 1000 && known.is_sorted());
    let packed = folder.path().join("bag.db3.zstd");
    let bytes = std::fs::read(folder.path().join("bag.db3")).unwrap();
    std::fs::write(&packed, zstd::encode_all(&bytes[..], 1).unwrap()).unwrap();
    let bag = BagReader::open(&packed).unwrap();
    assert_eq!((bag.notes(), bag.span_ns()), (&[] as &[String], Some((1, 1000))));
    assert_eq!(bag.messages().map(|m| m.unwrap().log_time_ns).collect::<Vec<_>>(), known);
}

#[test]
fn tables_that_compute_their_rows_are_refused_and_computed_values_limited() {
    let folder = tempfile::tempdir().unwrap();
    drop(bag_of(folder.path(), &["1, 10"]));
    let path = folder.path().join("bag.db3");
    let database = Connection::open(&path).unwrap();
    // A row of a few bytes whose value would have 900 MB.
    database.execute_batch(
        "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL); INSERT INTO messages(topic_id, timestamp) VALUES (1, 10)",
    ).unwrap();
    let bag = BagReader::open(&path).unwrap();
    let errors: Vec<String> = bag.messages().filter_map(Result::err).map(|e| e.to_string()).collect();
    let found = [bag.notes(), &errors].concat();
    assert!(found.len() == 1 && found[0].contains("too big"), "{found:?}");
    database.execute_batch(
        "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) SELECT id, 1 AS topic_id, 5 AS timestamp, x'00' AS data FROM n",
    ).unwrap();
    let error = BagReader::open(&path).unwrap_err().to_string();
    assert!(error.contains("bag.db3: expected a table `messages`, found a view that computes its rows"), "{error}");
}
