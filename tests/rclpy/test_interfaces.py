"""Every interface is the same to rosidl and to the Rust side: type hashes, and CDR bytes of instances that both count up."""

import json
import os
import pathlib
import subprocess

import pytest
from cdr import counted_message, pieces, rosidl_class
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def table():
    command = ["cargo", "run", "--quiet", "--release", "-p", "catenary_msgs", "--features", "filled", "--example", "interface_table"]
    output = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return {row["type_name"]: row for row in json.loads(output)}


def hashes_of_rosidl():
    """Type name to hash, from the descriptions that rosidl installed."""
    found = {}
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(":"):
        for path in pathlib.Path(prefix, "share").glob("*/*/*.json"):
            for row in json.loads(path.read_text()).get("type_hashes", []):
                found[row["type_name"]] = row["hash_string"]
    return found


def structures(table):
    """Rows of messages and of the parts of services and actions."""
    rows = [row for row in table.values() if "cdr_filled_hex" in row]
    assert len(rows) > 60
    return rows


def test_type_hashes_equal_those_of_rosidl(table):
    theirs = hashes_of_rosidl()
    assert not [name for name in table if name not in theirs]
    different = [name for name, row in table.items() if theirs[name] != row["hash"]]
    assert not different
    assert len(table) > 80


def test_every_interface_of_the_package_is_in_the_table(table):
    ours = [name for name in hashes_of_rosidl() if name.startswith("catenary_msgs/")]
    derived = ("_Event", "_SendGoal", "_GetResult", "_FeedbackMessage", "_Request", "_Response")
    named = [name for name in ours if not name.endswith(derived) or "/srv/" in name and not name.endswith("_Event")]
    assert len(named) > 30
    assert not [name for name in named if name not in table]


def test_cdr_bytes_equal_those_of_rclpy(table):
    for row in structures(table):
        name = row["type_name"]
        for key, counter in (("cdr_filled_hex", [0]), ("cdr_default_hex", None)):
            message = counted_message(rosidl_class(name), counter)
            ours, theirs = bytes.fromhex(row[key]), serialize_message(message)
            assert ours[:2] == theirs[:2] == b"\x00\x01", name
            (our_pieces, our_end), (their_pieces, _) = pieces(ours, message), pieces(theirs, message)
            assert our_pieces == their_pieces, f"{name} {key}"
            # rclpy returns as many bytes as it estimated, stale ones behind the message included; Rust writes no more than it.
            assert our_end == len(ours), f"{name} {key}"


def test_rclpy_reads_what_rust_wrote(table):
    for row in structures(table):
        cls = rosidl_class(row["type_name"])
        read = deserialize_message(bytes.fromhex(row["cdr_filled_hex"]), cls)
        assert read == counted_message(cls, [0]), row["type_name"]


def test_definitions_are_complete_and_have_the_type_hash(table):
    """Each ros2msg text alone gives a reader of bags the type, with the hash that the Rust side states."""
    # rosbags gives `char` another identifier than rosidl, whose hash of this type is compared above.
    with_char = "service_msgs/msg/ServiceEventInfo"
    messages = [row for name, row in table.items() if "/msg/" in name and name != with_char]
    assert len(messages) > 30
    for row in messages:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(row["definition"], row["type_name"]))
        assert store.hash_rihs01(row["type_name"]) == row["hash"], row["type_name"]
