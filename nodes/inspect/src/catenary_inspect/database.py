"""One file of a bag in the older format of rosbag2, a database of sqlite3."""

import contextlib
import sqlite3

MAGIC = b"SQLite format 3"


def read(path, source, reading, notes):
    """Gives the messages of `source`, which notes call `path`, to `reading` in the order of the file, up to the first damage."""
    taken = 0
    with contextlib.closing(sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro", uri=True)) as database:
        database.row_factory = sqlite3.Row
        try:
            # Lets sqlite3 read a truncated database, which it refuses otherwise. The file is open read-only all the same.
            database.execute("PRAGMA writable_schema = 1")
            topics = topics_of(database, reading)
            for number, time_ns, data in database.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"):
                if number in topics:
                    reading.take(*topics[number], time_ns, data)
                    taken += 1
        except sqlite3.Error as error:
            notes.append(f"{path}: damaged: {taken} messages were found: {error}")


def topics_of(database, reading):
    """Name and definition of each topic, by its number in the database."""
    texts = {}
    # Older recorders wrote no definitions.
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
        for row in database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"):
            texts[row[0]] = (row[1], row[2])
    topics = {}
    for row in database.execute("SELECT * FROM topics"):
        language, text = texts.get(row["type"], ("", ""))
        topics[row["id"]] = (row["name"], (row["type"], row["serialization_format"], language, text))
        columns = row.keys()
        reading.define(row["name"], row["type"], row["offered_qos_profiles"] if "offered_qos_profiles" in columns else "")
    return topics
