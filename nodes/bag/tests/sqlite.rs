//! Bags in sqlite3 with rows that no recorder should write: times before 1970, and rows without a topic.
#![allow(clippy::unwrap_used, reason = "a failure of a test is a panic")]

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
