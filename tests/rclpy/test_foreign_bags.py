"""Bags that rosbags wrote, in both formats and every compression, of both distributions; and bags that are damaged."""

import itertools
import json
import pathlib
import shutil
import sqlite3
import subprocess

import pytest
from conftest import PROGRAM
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = pathlib.Path(__file__).resolve().parents[2]
BAG, MODEL = ROOT / "bags/swing", ROOT / "launch_configs/models/soft_bar.yaml"
NONE, MESSAGE, FILE, STORAGE = CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE, CompressionMode.STORAGE
MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60)


def info(bag):
    done = run("info", bag, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def motion(bag):
    """What comes of every keypoint and pose of a bag: how far a simulated bar stays from the recorded one."""
    done = run("simulate", "--model", MODEL, "--track", bag, "--fidelity", "fast", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    return {key: value for key, value in report.items() if "bag" not in str(value)}


@pytest.fixture(scope="module")
def original():
    return motion(BAG)


def store_with(reader, store):
    """The types of a distribution, and those of the bag that it does not have."""
    store = get_typestore(store)
    for connection in reader.connections:
        types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
        store.register({name: kind for name, kind in types.items() if name not in store.types})
    return store


def rewrite(out, plugin, mode, version, distribution):
    """Decodes the sample bag and writes it anew with the types of a distribution."""
    with Reader(BAG) as reader, Writer(out, version=version, storage_plugin=plugin) as writer:
        store = store_with(reader, distribution)
    with Reader(BAG) as reader:
        shutil.rmtree(out)
        writer = Writer(out, version=version, storage_plugin=plugin)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            topics = {
                c.id: writer.add_connection(c.topic, c.msgtype, typestore=store, offered_qos_profiles=c.ext.offered_qos_profiles)
                for c in reader.connections
            }
            for connection, time, data in reader.messages():
                message = store.deserialize_cdr(data, connection.msgtype)
                writer.write(topics[connection.id], time, store.serialize_cdr(message, connection.msgtype))
    return out


HUMBLE, JAZZY = Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY
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
def test_a_bag_of_rosbags_holds_what_it_was_written_from(tmp_path, original, way):
    bag = rewrite(tmp_path / "bag", *way)
    theirs, ours = info(BAG), info(bag)
    # rosbags writes hashes into databases alone.
    for topic in theirs["topics"] if way[0] == MCAP else []:
        topic["type_hash"] = None
    for key in ("messages", "start_ns", "duration_s", "topics", "notes"):
        assert ours[key] == theirs[key], key
    assert motion(bag) == original


def humble(tmp_path):
    """The sample bag as a recorder of ROS 2 Humble leaves it: sqlite3 of schema 3, metadata of version 5, no hashes."""
    bag = rewrite(tmp_path / "humble", SQLITE, NONE, 8, HUMBLE)
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


def test_a_bag_of_humbles_recorder_is_read(tmp_path, original):
    bag = humble(tmp_path)
    theirs, ours = info(BAG), info(bag)
    assert all(topic["type_hash"] is None for topic in ours["topics"])
    assert [(t["name"], t["type"], t["messages"], t["offered_qos"]) for t in ours["topics"]] == [
        (t["name"], t["type"], t["messages"], t["offered_qos"]) for t in theirs["topics"]
    ]
    assert motion(bag) == original
    alone = info(bag / "humble_0.db3")
    assert (alone["messages"], alone["topics"]) == (ours["messages"], ours["topics"])


def test_what_can_be_had_of_a_damaged_database_is_read_and_the_rest_is_named(tmp_path):
    bag = humble(tmp_path)
    file = bag / "humble_0.db3"
    whole = file.read_bytes()
    found = []
    for share in (0.9, 0.5, 0.2):
        file.write_bytes(whole[: int(share * len(whole))])
        report = info(bag)
        note, *unreadable = report["notes"]
        assert str(file) in note and f"damaged: {report['messages']} messages were found" in note
        # The last one or two go on beyond the cut.
        assert report["messages"] - 3 < report["readable"] <= report["messages"] and len(unreadable) < 4, report["notes"]
        found.append(report["messages"])
    assert 543 > found[0] > found[1] > found[2] > 0
    file.write_bytes(whole[:50])
    done = run("info", bag)
    assert done.returncode == 2 and str(file) in done.stderr and done.stdout == ""


def test_a_file_without_chunks_is_read_and_misses_nothing(tmp_path):
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
    assert run("reindex", file).stdout == f"{file}: 3 messages\n" and file.read_bytes() == whole
    file.write_bytes(whole[:-60])
    (note,) = info(file)["notes"]
    assert "3 messages were found outside of chunks" in note


def test_damage_that_the_index_does_not_show_is_named(tmp_path):
    bag = shutil.copytree(BAG, tmp_path / "swing")
    file = bag / "swing_0.mcap"
    data = bytearray(file.read_bytes())
    data[2000] ^= 0x55
    file.write_bytes(data)
    report = info(bag)
    assert report["messages"] == 543 and 0 < report["readable"] < 543
    said, where, *_of_episodes = report["notes"]
    assert said == f"{bag}: {report['readable']} of 543 messages can be read" and f"{file}: damaged at byte" in where
    assert said in run("info", bag).stdout
    index = run("info", bag, "--index-only")
    assert "by the index alone" in index.stdout.splitlines()[0] and "damaged" not in index.stdout
    assert info(BAG)["readable"] == 543


def test_empty_missing_and_foreign_bags_are_named(tmp_path):
    def refused(path, *says):
        done = run("info", path)
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
            done = run(*command, tmp_path / plugin.name)
            assert done.returncode == 2 and "no topics" in done.stderr, done.stderr


def test_a_split_bag_that_lost_a_file_gives_the_others(tmp_path):
    """Three files of rosbags' own, in one folder under one metadata.yaml."""
    with Reader(BAG) as reader:
        rows = [(c.topic, c.msgtype, c.msgdef.data, c.digest, time, bytes(data)) for c, time, data in reader.messages()]
    bag = tmp_path / "split"
    bag.mkdir()
    counts = []
    for number, part in enumerate(itertools.batched(rows, 200) if hasattr(itertools, "batched") else [rows[:200], rows[200:400], rows[400:]]):
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
