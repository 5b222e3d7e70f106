"""Bags that rosbags wrote (both formats, every compression, two ROS 2 distributions), and damaged bags."""

import shutil
import sqlite3

import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores

from support.bags import rewritten
from support.program import BAG, MODEL

NONE, MESSAGE, FILE, STORAGE = CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE, CompressionMode.STORAGE
MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


@pytest.fixture(scope="module")
def info(program):
    """Document that `catenary info` prints for a bag."""
    return lambda bag: program.json("info", bag)


@pytest.fixture(scope="module")
def motion(program):
    """Report of a simulated bar that follows the recorded motion; it depends on every keypoint and pose of the bag."""

    def of_bag(bag):
        report = program.json("simulate", "--model", MODEL, "--track", bag, "--fidelity", "fast")
        return {key: value for key, value in report.items() if "bag" not in str(value)}

    return of_bag


@pytest.fixture(scope="module")
def original(motion):
    """Report for the sample bag itself."""
    return motion(BAG)


HUMBLE, JAZZY = Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY
# Format, compression, version of metadata.yaml and distribution of a bag.
WAYS = [
    (MCAP, NONE, 9, JAZZY),
    (MCAP, STORAGE, 9, HUMBLE),
    (MCAP, MESSAGE, 8, JAZZY),
    (MCAP, FILE, 8, HUMBLE),
    (SQLITE, NONE, 9, JAZZY),
    (SQLITE, NONE, 8, HUMBLE),
    (SQLITE, MESSAGE, 9, HUMBLE),
    (SQLITE, FILE, 9, JAZZY),
]


@pytest.mark.parametrize("way", WAYS, ids=lambda way: "-".join(str(getattr(part, "name", part)).lower() for part in way))
def test_a_bag_of_rosbags_has_the_content_of_its_source(info, motion, tmp_path, original, way):
    plugin, mode, version, distribution = way
    bag = rewritten(tmp_path / "bag", plugin=plugin, mode=mode, version=version, distribution=distribution)
    theirs, ours = info(BAG), info(bag)
    # rosbags writes type hashes into databases only.
    for topic in theirs["topics"] if plugin == MCAP else []:
        topic["type_hash"] = None
    for key in ("messages", "start_ns", "duration_s", "topics", "notes"):
        assert ours[key] == theirs[key], key
    assert motion(bag) == original


def humble(tmp_path):
    """The sample bag as a recorder of ROS 2 Humble leaves it: sqlite3 of schema 3, metadata of version 5, no hashes."""
    bag = rewritten(tmp_path / "humble", plugin=SQLITE, version=8, distribution=HUMBLE)
    with sqlite3.connect(bag / "humble.db3") as database:
        database.executescript(
            "DROP TABLE message_definitions; DROP TABLE metadata; DROP TABLE schema;"
            "ALTER TABLE topics DROP COLUMN type_description_hash; ALTER TABLE messages RENAME TO old;"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            "INSERT INTO messages SELECT * FROM old; DROP TABLE old; CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
        )
    (bag / "humble.db3").rename(bag / "humble_0.db3")
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  duration:\n    nanoseconds: 4100000000\n"
        "  starting_time:\n    nanoseconds_since_epoch: 99900500000\n  message_count: 543\n  topics_with_message_count: []\n"
        '  compression_format: ""\n  compression_mode: ""\n  relative_file_paths:\n    - humble_0.db3\n'
        "  files:\n    - path: humble_0.db3\n      starting_time:\n        nanoseconds_since_epoch: 99900500000\n"
        "      duration:\n        nanoseconds: 4100000000\n      message_count: 543\n"
    )
    return bag


def test_a_bag_of_humbles_recorder_is_read(info, motion, tmp_path, original):
    bag = humble(tmp_path)
    theirs, ours = info(BAG), info(bag)
    assert all(topic["type_hash"] is None for topic in ours["topics"])
    assert [(t["name"], t["type"], t["messages"], t["offered_qos"]) for t in ours["topics"]] == [
        (t["name"], t["type"], t["messages"], t["offered_qos"]) for t in theirs["topics"]
    ]
    assert motion(bag) == original
    alone = info(bag / "humble_0.db3")
    assert (alone["messages"], alone["topics"]) == (ours["messages"], ours["topics"])


def test_the_readable_messages_of_a_damaged_database_are_read_and_the_rest_is_named(program, info, tmp_path):
    bag = humble(tmp_path)
    file = bag / "humble_0.db3"
    whole = file.read_bytes()
    found = []
    for share in (0.9, 0.5, 0.2):
        file.write_bytes(whole[: int(share * len(whole))])
        report = info(bag)
        note, *unreadable = report["notes"]
        assert str(file) in note and f"damaged: {report['messages']} messages were found" in note
        # The cut may go through the last one or two messages.
        assert report["messages"] - 3 < report["readable"] <= report["messages"] and len(unreadable) < 4, report["notes"]
        found.append(report["messages"])
    assert 543 > found[0] > found[1] > found[2] > 0
    file.write_bytes(whole[:50])
    done = program("info", bag)
    assert done.returncode == 2 and str(file) in done.stderr and done.stdout == ""


def test_a_file_without_chunks_is_read_whole(program, info, tmp_path):
    file = tmp_path / "bag.mcap"
    with open(file, "wb") as target:
        writer = McapWriter(target, use_chunking=False)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/Int32", "ros2msg", b"int32 data\n")
        channel = writer.register_channel("/lab/number", "cdr", schema)
        for time_ns in (5, 3, 4):
            writer.add_message(channel, time_ns, b"\0\1\0\0\7\0\0\0", time_ns)
        writer.finish()
    whole = file.read_bytes()
    report = info(file)
    assert (report["messages"], report["readable"], report["notes"], report["start_ns"]) == (3, 3, [], 3)
    assert program("reindex", file).stdout == f"{file}: 3 messages\n" and file.read_bytes() == whole
    file.write_bytes(whole[:-60])
    (note,) = info(file)["notes"]
    assert "3 messages were found outside of chunks" in note


def test_damage_that_the_index_does_not_show_is_named(program, info, tmp_path):
    bag = shutil.copytree(BAG, tmp_path / "swing")
    file = bag / "swing_0.mcap"
    data = bytearray(file.read_bytes())
    data[2000] ^= 0x55
    file.write_bytes(data)
    report = info(bag)
    assert report["messages"] == 543 and 0 < report["readable"] < 543
    said, where, *_of_episodes = report["notes"]
    assert said == f"{bag}: {report['readable']} of 543 messages can be read" and f"{file}: damaged at byte" in where
    assert said in program("info", bag).stdout
    index = program("info", bag, "--index-only")
    assert "by the index alone" in index.stdout.splitlines()[0] and "damaged" not in index.stdout
    assert info(BAG)["readable"] == 543


def test_empty_missing_and_foreign_bags_are_named(program, info, tmp_path):
    def refused(path, *says):
        done = program("info", path)
        assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1, done.stderr
        assert str(path) in done.stderr and all(part in done.stderr for part in says), done.stderr

    refused(tmp_path / "nowhere", "expected a bag folder or an .mcap or .db3 file, found nothing")
    refused(tmp_path, "found an empty folder")
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    refused(tmp_path / "old.bag", "bags of ROS 1", "rosbags-convert")
    refused(tmp_path, "a folder without .mcap or .db3 files that holds old.bag")
    (tmp_path / "empty.mcap").write_bytes(b"")
    refused(tmp_path / "empty.mcap", "an empty file")
    for plugin in (MCAP, SQLITE):
        with Writer(tmp_path / plugin.name, version=9, storage_plugin=plugin):
            pass
        report = info(tmp_path / plugin.name)
        assert (report["messages"], report["topics"], report["notes"], report["start_ns"]) == (0, [], [], None)
        for command in (("replay",), ("infer", "--model", MODEL, "--out", tmp_path / "out", "--bag")):
            done = program(*command, tmp_path / plugin.name)
            assert done.returncode == 2 and "no topics" in done.stderr, done.stderr


def test_a_split_bag_that_lost_a_file_gives_the_others(info, tmp_path):
    """Splits the sample bag into three files of rosbags in one folder, with one metadata.yaml."""
    with Reader(BAG) as reader:
        rows = [(c.topic, c.msgtype, c.msgdef.data, c.digest, time, bytes(data)) for c, time, data in reader.messages()]
    bag = tmp_path / "split"
    bag.mkdir()
    counts = []
    for number, part in enumerate((rows[:200], rows[200:400], rows[400:])):
        with Writer(tmp_path / f"part{number}", version=9, storage_plugin=MCAP) as writer:
            topics = {}
            for topic, kind, text, digest, time, data in part:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, msgdef=text, rihs01=digest)
                writer.write(topics[topic], time, data)
        (tmp_path / f"part{number}/part{number}.mcap").rename(bag / f"split_{number}.mcap")
        counts.append(len(part))
    names = "".join(f"    - split_{number}.mcap\n" for number in range(len(counts)))
    (bag / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  relative_file_paths:\n{names}"
    )
    whole = info(bag)
    assert (whole["messages"], whole["notes"], len(whole["files"])) == (543, [], 3)
    (bag / "split_1.mcap").unlink()
    half = info(bag)
    (note,) = half["notes"]
    assert half["messages"] == 543 - counts[1] and f"{bag}/split_1.mcap: listed in metadata.yaml, and missing" in note
    (bag / "metadata.yaml").unlink()
    assert "metadata.yaml is missing" in info(bag)["notes"][0]
