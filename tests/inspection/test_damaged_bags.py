"""catenary-inspect on damaged, unfinished, compressed and foreign bags: it shows the readable messages and names the missing ones."""

import gc
import io
import random
import shutil
import sqlite3

import pytest
from catenary_inspect.main import main
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from support.bags import copied
from support.program import BAG

# Messages of the sample bag on /dlo/keypoints and on all topics.
FRAMES, MESSAGES = 83, 543


def copy(folder, name="bag"):
    """Copies the sample bag; returns its folder and its file."""
    shutil.copytree(BAG, folder / name)
    return folder / name, folder / name / "swing_0.mcap"


def chunks(file):
    """Offsets of the begin and the end of each chunk of a finished file."""
    with open(file, "rb") as stream:
        return [(c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in make_reader(stream).get_summary().chunk_indexes]


def spoil(file, place):
    """Inverts the byte of a file at an offset."""
    content = bytearray(file.read_bytes())
    content[place] ^= 0xFF
    file.write_bytes(content)


def test_the_sample_bag_misses_nothing(figures):
    said = figures("keypoints", "--bag", BAG)
    assert said["frames"] == FRAMES and said["notes"] == []
    assert figures("graph", "--bag", BAG) == figures("graph", "--bag", BAG / "swing_0.mcap")


@pytest.mark.parametrize("chunk", [0, 2])
def test_a_damaged_chunk_costs_its_own_messages_alone(figures, tmp_path, chunk):
    """Chunk 0 matters most, because it holds the definitions of all later messages."""
    bag, file = copy(tmp_path)
    begin, end = chunks(file)[chunk]
    spoil(file, (begin + end) // 2)
    for given in (bag, file):
        said = figures("graph", "--bag", given)
        left = sum(row["count"] for row in said["topics"])
        assert MESSAGES / 2 < left < MESSAGES
        (note,) = said["notes"]
        assert str(file) in note and f"chunk at byte {begin}" in note and f"{MESSAGES - left} of its {MESSAGES} messages" in note
    assert 0 < figures("keypoints", "--bag", bag)["frames"] < FRAMES


def test_reading_goes_on_after_a_record_of_wrong_length(figures, tmp_path):
    _, file = copy(tmp_path)
    begin, _ = chunks(file)[1]
    # A byte of the chunk's length.
    spoil(file, begin + 5)
    said = figures("graph", "--bag", file)
    left = sum(row["count"] for row in said["topics"])
    (note,) = said["notes"]
    assert MESSAGES / 2 < left < MESSAGES and f"damaged from byte {begin} to {chunks(file)[2][0]}" in note
    assert f"{MESSAGES - left} of its {MESSAGES} messages" in note


def test_a_changed_byte_in_an_uncompressed_chunk_is_noticed(figures, tmp_path):
    """The checksum of the chunk shows it, which decoders of messages do not."""
    stream = io.BytesIO()
    with open(BAG / "swing_0.mcap", "rb") as source:
        writer, schemas, channels = McapWriter(stream, chunk_size=8_000, compression=CompressionType.NONE), {}, {}
        writer.start("ros2")
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.id not in channels:
                schemas[schema.id] = schemas.get(schema.id) or writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", schemas[schema.id], channel.metadata)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    file = tmp_path / "plain.mcap"
    file.write_bytes(stream.getvalue())
    assert figures("keypoints", "--bag", file) == figures("keypoints", "--bag", BAG / "swing_0.mcap")
    _, end = chunks(file)[3]
    spoil(file, end - 20)
    said = figures("graph", "--bag", file)
    assert 0 < sum(row["count"] for row in said["topics"]) < MESSAGES and "chunk" in said["notes"][0]


def test_the_folder_of_a_killed_recorder_gives_its_messages(figures, tmp_path, capsys):
    bag, file = copy(tmp_path, "killed")
    begin, end = chunks(file)[3]
    file.write_bytes(file.read_bytes()[: (begin + end) // 2])
    listed = figures("keypoints", "--bag", bag)
    (bag / "metadata.yaml").unlink()
    said = figures("keypoints", "--bag", bag)
    assert 0 < said["frames"] < FRAMES and said["points"] == listed["points"]
    missing, cut, hint = said["notes"]
    assert str(bag) in missing and "metadata.yaml" in missing
    assert str(file) in cut and "not finished" in cut
    assert f"`catenary reindex {bag}`" in hint
    assert listed["notes"] == [cut, hint]
    # Notes go to stderr, so that stdout holds the table alone.
    assert main(["keypoints", "--bag", str(bag)]) == 0
    shown = capsys.readouterr()
    assert f"catenary-inspect: {hint}" in shown.err.splitlines() and "reindex" not in shown.out
    assert figures("keypoints", "--bag", file)["notes"] == [cut, f"`catenary reindex {file}` finishes it"]


def test_reserved_space_at_the_end_of_a_file_is_no_message(figures, tmp_path):
    _, file = copy(tmp_path)
    begin, _ = chunks(file)[3]
    file.write_bytes(file.read_bytes()[:begin] + bytes(100_000))
    said = figures("keypoints", "--bag", file)
    assert 0 < said["frames"] < FRAMES and "and nothing in its last 100000 bytes" in said["notes"][0]
    file.write_bytes(file.read_bytes()[:-100_000])
    left = sum(row["count"] for row in figures("graph", "--bag", file)["topics"])
    assert figures("graph", "--bag", file)["notes"][0] == f"{file}: not finished: {left} messages were found"


def test_a_file_without_its_summary_is_named_and_loses_nothing(figures, tmp_path):
    """Readers that seek need the summary."""
    _, file = copy(tmp_path)
    file.write_bytes(file.read_bytes()[:-40])
    note, hint = figures("graph", "--bag", file)["notes"]
    assert note == f"{file}: it has no summary: {MESSAGES} messages were found" and "catenary reindex" in hint


def test_differences_between_metadata_yaml_and_the_files_are_named(figures, refused, tmp_path):
    bag, file = copy(tmp_path)
    metadata = bag / "metadata.yaml"
    file.rename(bag / "swing_7.mcap")
    said = figures("keypoints", "--bag", bag)
    assert said["frames"] == FRAMES
    assert any("swing_0.mcap" in note and "missing" in note for note in said["notes"])
    assert any("swing_7.mcap" in note and "not listed" in note for note in said["notes"])
    metadata.write_text("rosbag2_bagfile_information: [")
    assert any("metadata.yaml" in note for note in figures("keypoints", "--bag", bag)["notes"])
    (bag / "swing_7.mcap").unlink()
    refused("keypoints", "--bag", bag, says=(str(bag), "expected a bag folder", "metadata.yaml"))
    (bag / "swing_0.mcap").write_bytes(b"")
    refused("keypoints", "--bag", bag, says=("swing_0.mcap", "an empty file"))


@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE, CompressionMode.STORAGE])
def test_compressed_bags_are_read_as_folders_and_as_files(figures, tmp_path, mode):
    bag = copied(tmp_path / "bag", mode=mode)
    (file,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
    expected = figures("keypoints", "--bag", BAG)
    for given in (bag, file):
        assert figures("keypoints", "--bag", given) == expected
    assert figures("graph", "--bag", file) == figures("graph", "--bag", BAG)


@pytest.mark.parametrize("mode", [None, CompressionMode.MESSAGE])
def test_databases_are_read_as_folders_and_as_files(figures, tmp_path, mode):
    bag = copied(tmp_path / "bag", plugin=StoragePlugin.SQLITE3, mode=mode)
    for given in (bag, bag / "bag.db3"):
        assert figures("keypoints", "--bag", given) == figures("keypoints", "--bag", BAG)
    (bag / "metadata.yaml").unlink()
    missing, hint = figures("keypoints", "--bag", bag)["notes"]
    assert "metadata.yaml" in missing and f"`ros2 bag reindex {bag}`" in hint


def test_a_damaged_database_gives_its_readable_messages(figures, refused, tmp_path):
    file = copied(tmp_path / "bag", plugin=StoragePlugin.SQLITE3) / "bag.db3"
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    said = figures("graph", "--bag", file)
    left = sum(row["count"] for row in said["topics"])
    assert 0 < left < MESSAGES
    assert any(str(file) in note and f"damaged: {left} messages were found" in note for note in said["notes"])
    file.write_bytes(content[:600])
    refused("keypoints", "--bag", file, says=(str(file), "expected messages, found none", "damaged"))
    with sqlite3.connect(tmp_path / "other.db3") as other:
        other.execute("CREATE TABLE tea (pot TEXT)")
    refused("keypoints", "--bag", tmp_path / "other.db3", says=("other.db3", "messages"))


def test_messages_that_cannot_be_decoded_are_counted_and_named(figures, tmp_path, capsys):
    stream = io.BytesIO()
    writer = McapWriter(stream)
    writer.start("ros2")
    foreign = writer.register_schema("catenary_msgs/msg/Keypoints", "jsonschema", b"{}")
    channel = writer.register_channel("/dlo/keypoints", "json", foreign)
    writer.add_message(channel, 1, b"{}", 1)
    writer.finish()
    file = tmp_path / "foreign.mcap"
    file.write_bytes(stream.getvalue())
    assert main(["keypoints", "--bag", str(file)]) == 1
    note, error = capsys.readouterr().err.splitlines()
    assert "/dlo/keypoints" in note and "1 of 1" in note and "expected cdr, found json" in note
    assert error.startswith("catenary-inspect: ") and "expected messages on /dlo/keypoints" in error
    assert figures("graph", "--bag", file)["topics"][0]["count"] == 1


def changed_copy(file, language=None, definition=None, time_of=lambda topic, number, time_ns: time_ns):
    """Writes the sample bag with another definition of keypoints, or other log times."""
    with open(BAG / "swing_0.mcap", "rb") as source, open(file, "wb") as target:
        writer, schemas, channels, counts = McapWriter(target), {}, {}, {}
        writer.start("ros2")
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.id not in channels:
                text = (language, definition) if language and channel.topic == "/dlo/keypoints" else (schema.encoding, schema.data)
                schemas[schema.id] = schemas.get(schema.id) or writer.register_schema(schema.name, *text)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", schemas[schema.id], channel.metadata)
            number = counts[channel.id] = counts.get(channel.id, -1) + 1
            time_ns = time_of(channel.topic, number, message.log_time)
            writer.add_message(channels[channel.id], time_ns, message.data, message.publish_time)
        writer.finish()
    return file


IDL = """module builtin_interfaces { module msg { struct Time { long sec; unsigned long nanosec; }; }; };
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
module catenary_msgs { module msg {
  typedef double double__4[4];
  typedef float float__4[4];
  struct Keypoints {
    std_msgs::msg::Header header; unsigned long image_width; unsigned long image_height;
    double__4 dlo_u; double__4 dlo_v; float__4 dlo_scores;
    boolean target_seen; double target_u; double target_v; float target_score;
  };
}; };
"""


@pytest.mark.parametrize("language", ["ros2idl", "omgidl"])
def test_definitions_in_idl_are_as_good_as_those_in_ros2msg(figures, tmp_path, language):
    file = changed_copy(tmp_path / "idl.mcap", language, IDL.encode())
    assert figures("keypoints", "--bag", file) == figures("keypoints", "--bag", BAG / "swing_0.mcap")


def test_messages_that_are_logged_decades_away_are_named_and_left_out(figures, tmp_path):
    recorded = 1_700_000_000 * 10**9
    at = {("/dlo/keypoints", 20): 0, ("/dlo/keypoints", 30): 2**64 - 1, ("/panda/current_pose", 120): 2**63}
    file = changed_copy(tmp_path / "far.mcap", time_of=lambda topic, number, time_ns: at.get((topic, number), recorded + time_ns))
    said = figures("graph", "--bag", file)
    rates = {row["name"]: row["rate_hz"] for row in said["topics"]}
    assert 19 < rates["/dlo/keypoints"] < 21 and 49 < rates["/panda/current_pose"] < 51
    keypoints, poses = said["notes"]
    assert keypoints.startswith(
        "/dlo/keypoints: 2 messages are logged more than ten years away from the rest, at 0 ns, 18446744073709551615"
    )
    assert poses.startswith("/panda/current_pose: 1 message is logged")
    assert figures("keypoints", "--bag", file)["frames"] == FRAMES - 2


def test_impossible_log_times_are_left_out_also_where_they_are_the_most(figures, tmp_path):
    recorded = 1_700_000_000 * 10**9
    time_of = lambda topic, number, time_ns: 2**64 - 1 - number if number % 3 else recorded + time_ns
    file = changed_copy(tmp_path / "far.mcap", time_of=time_of)
    assert figures("keypoints", "--bag", file)["frames"] == (FRAMES + 2) // 3


@pytest.mark.parametrize("command", ["graph", "keypoints", "episode"])
def test_no_damage_ends_in_a_traceback(tmp_path, capsys, command):
    """Damages the file 36 times: cut off, one byte changed, or 64 bytes set to zero, anywhere."""
    bag, file = copy(tmp_path)
    content, rng, codes = file.read_bytes(), random.Random(5), []
    # Finalisers of objects of earlier tests may print, and this test checks every line on stderr.
    gc.collect()
    capsys.readouterr()
    for number in range(36):
        spoiled, place = bytearray(content), rng.randrange(len(content))
        if number % 3 == 0:
            spoiled = spoiled[:place]
        elif number % 3 == 1:
            spoiled[place] ^= 1 + rng.randrange(255)
        else:
            spoiled[place : place + 64] = bytes(len(spoiled[place : place + 64]))
        file.write_bytes(spoiled)
        codes.append(main([command, "--bag", str(rng.choice((bag, file)))]))
        said = capsys.readouterr()
        assert all(line.startswith("catenary-inspect: ") for line in said.err.splitlines()), said.err
    assert set(codes) <= {0, 1} and codes.count(0) > 18
