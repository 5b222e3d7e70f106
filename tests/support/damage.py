"""Damaged copies of a file: each value of it removed, or replaced by one of another kind, sign or size."""

import copy
import json
import struct

# More entries than any honest file has, for each list.
MANY = 2_000_000
WRONG = {"null": None, "negative": -1.5, "zero": 0, "huge": 1e300, "not a number": "NaN", "word": "x", "empty list": [], "object": {"a": 1}}


def places(tree, path=()):
    """Paths of all values in a tree of dictionaries and lists, leaves and inner ones."""
    inside = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in inside:
        yield (*path, key)
        yield from places(value, (*path, key))


def changed(tree, path, change):
    """Copy of a tree in which `change(parent, key)` was applied at `path`."""
    whole = copy.deepcopy(tree)
    parent = whole
    for key in path[:-1]:
        parent = parent[key]
    change(parent, path[-1])
    return whole


def damaged(tree):
    """Damaged copies of a tree, each with the path and the name of the damage."""
    for path in places(tree):
        yield path, "removed", changed(tree, path, lambda parent, key: parent.pop(key))
        for name, value in WRONG.items():
            yield path, name, changed(tree, path, lambda parent, key, value=value: parent.__setitem__(key, value))


def long_lists(tree):
    """Copies of a tree in which one list has very many entries, with its path."""
    for path in places(tree):
        value = tree
        for key in path:
            value = value[key]
        if isinstance(value, list) and value and not isinstance(value[0], (dict, list)):
            yield path, "many", changed(tree, path, lambda parent, key, value=value: parent.__setitem__(key, [value[0]] * MANY))


def safetensors(blob):
    """Header and data of a safetensors file."""
    (length,) = struct.unpack("<Q", blob[:8])
    return json.loads(blob[8 : 8 + length]), blob[8 + length :]


def of_safetensors(header, data):
    """Bytes of a safetensors file."""
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + data
