"""Type hashes of interfaces as rosidl installed them."""

import json
import os
import pathlib


def type_hashes(pattern="*/*/*.json"):
    """Type name to hash (RIHS01) of all descriptions below `share` of AMENT_PREFIX_PATH that fit the pattern."""
    found = {}
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(":"):
        for path in pathlib.Path(prefix, "share").glob(pattern):
            for row in json.loads(path.read_text()).get("type_hashes", []):
                found[row["type_name"]] = row["hash_string"]
    return found
