"""Every interface is the same to rosidl and to the Rust side: type hashes, and CDR bytes of instances that both count up.

tf2_msgs has no wheel; rosbags, which computes hashes and CDR by itself, stands in for rosidl there.
"""

import importlib
import json
import os
import pathlib
import subprocess

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosidl_parser.definition import AbstractNestedType, Array, BasicType, UnboundedString

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


def get_interface(type_name):
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def counted(kind, counter):
    """The next counted value of a rosidl type: see `Filled` in the Rust crate. With `counter` None, the value that is empty."""
    if isinstance(kind, AbstractNestedType):
        count = kind.size if isinstance(kind, Array) else 2 if counter else 0
        return [counted(kind.value_type, counter) for _ in range(count)]
    if isinstance(kind, (BasicType, UnboundedString)):
        number = 0
        if counter:
            counter[0] += 1
            number = counter[0]
        if isinstance(kind, UnboundedString):
            return f"s{number}" if counter else ""
        if kind.typename == "boolean":
            return number % 2 == 1
        if kind.typename in ("float", "double"):
            return number + 0.5 if counter else 0.0
        return bytes([number % 100]) if kind.typename == "octet" else number % 100
    return counted_message(get_interface("/".join(kind.namespaced_name())), counter)


def counted_message(cls, counter):
    message = cls()
    for name, kind in zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES):
        setattr(message, name, counted(kind, counter))
    return message


def rosidl_class(type_name):
    package, kind, name = type_name.split("/")
    if kind == "msg":
        return get_interface(type_name)
    base, part = name.rsplit("_", 1)
    return getattr(get_interface(f"{package}/{kind}/{base}"), part)


def structures(table):
    """Rows of messages and of the parts of services and actions, without those that rosidl does not hold."""
    rows = [row for row in table.values() if "cdr_filled_hex" in row and not row["type_name"].startswith("tf2_msgs/")]
    assert len(rows) > 60
    return rows


SIZES = {"boolean": 1, "octet": 1, "uint8": 1, "int8": 1, "char": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4}
SIZES |= {"float": 4, "int64": 8, "uint64": 8, "double": 8}


def layout(kind, value):
    """Alignment and size of each piece of a value in CDR, in order."""
    if isinstance(kind, AbstractNestedType):
        if not isinstance(kind, Array):
            yield 4, 4
        for element in value:
            yield from layout(kind.value_type, element)
    elif isinstance(kind, BasicType):
        yield SIZES[kind.typename], SIZES[kind.typename]
    elif isinstance(kind, UnboundedString):
        yield 4, 4
        yield 1, len(value.encode()) + 1
    else:
        yield from message_layout(value)


def message_layout(message):
    if not message.SLOT_TYPES:
        # An empty structure has a member on the wire that Python hides.
        yield 1, 1
    for name, kind in zip(message.get_fields_and_field_types(), message.SLOT_TYPES):
        yield from layout(kind, getattr(message, name))


def pieces(data, message):
    """The pieces of a CDR message, and where the last one ends. Padding is left out: Fast CDR leaves it uninitialised."""
    body, offset, found = data[4:], 0, []
    for alignment, size in message_layout(message):
        offset += -offset % alignment
        found.append(body[offset : offset + size])
        offset += size
    return found, offset + 4


def test_type_hashes_equal_those_of_rosidl(table):
    theirs = hashes_of_rosidl()
    unknown = [name for name in table if name not in theirs]
    assert unknown == ["tf2_msgs/msg/TFMessage"]
    different = [name for name, row in table.items() if name in theirs and theirs[name] != row["hash"]]
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


def test_tf_messages_are_read_by_rosbags(table):
    row = table["tf2_msgs/msg/TFMessage"]
    store = get_typestore(Stores.ROS2_JAZZY)
    assert store.hash_rihs01(row["type_name"]) == row["hash"]
    first, second = store.deserialize_cdr(bytes.fromhex(row["cdr_filled_hex"]), row["type_name"]).transforms
    assert (first.header.stamp.sec, first.header.frame_id, first.child_frame_id) == (1, "s3", "s4")
    assert (first.transform.translation.x, first.transform.rotation.w) == (5.5, 11.5)
    assert (second.header.stamp.sec, second.transform.rotation.w) == (12, 22.5)
