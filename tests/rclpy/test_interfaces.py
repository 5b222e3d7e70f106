"""Every interface is the same to rosidl and to the Rust side: type hashes, and CDR bytes of an instance that both count up."""

import importlib
import json
import os
import pathlib
import subprocess

import pytest
from rclpy.serialization import serialize_message
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


def filled(kind, counter):
    """The next counted value of a rosidl type: see `Filled` in the Rust crate."""
    if isinstance(kind, AbstractNestedType):
        count = kind.size if isinstance(kind, Array) else 2
        return [filled(kind.value_type, counter) for _ in range(count)]
    if isinstance(kind, BasicType):
        counter[0] += 1
        if kind.typename == "boolean":
            return counter[0] % 2 == 1
        if kind.typename in ("float", "double"):
            return counter[0] + 0.5
        if kind.typename == "octet":
            return bytes([counter[0] % 100])
        return counter[0] % 100
    if isinstance(kind, UnboundedString):
        counter[0] += 1
        return f"s{counter[0]}"
    return filled_message(get_interface("/".join(kind.namespaced_name())), counter)


def filled_message(cls, counter):
    message = cls()
    for name, kind in zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES):
        if name != "structure_needs_at_least_one_member":
            setattr(message, name, filled(kind, counter))
    return message


def rosidl_class(type_name):
    package, kind, name = type_name.split("/")
    if kind == "msg":
        return get_interface(type_name)
    base, part = name.rsplit("_", 1)
    return getattr(get_interface(f"{package}/{kind}/{base}"), part)


def test_type_hashes_equal_those_of_rosidl(table):
    theirs = hashes_of_rosidl()
    unknown = [name for name in table if name not in theirs and not name.startswith("tf2_msgs/")]
    assert not unknown
    different = [name for name, row in table.items() if name in theirs and theirs[name] != row["hash"]]
    assert not different
    assert len(table) > 80


def test_cdr_bytes_equal_those_of_rclpy(table):
    checked = 0
    for name, row in table.items():
        if "cdr" not in row or name.startswith("tf2_msgs/"):
            continue
        theirs = serialize_message(filled_message(rosidl_class(name), [0])).hex()
        # The last three bytes may pad the message to a multiple of four.
        assert theirs.rstrip("0") == row["cdr"].rstrip("0"), name
        checked += 1
    assert checked > 60
