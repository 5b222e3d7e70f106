"""The table that our reader of parameters is tested with holds for rclpy: types and values from files and from -p."""

import json
import math
import pathlib

import rclpy

TABLE = pathlib.Path(__file__).resolve().parents[2] / "nodes/shell/src/args/rcl.json"


def written(value):
    """As the table has it: infinities and NaN in words."""
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else [written(item) for item in value]


def of_rclpy(arguments):
    """The values for /cam, none where rclpy refuses the arguments."""
    context = rclpy.Context()
    try:
        context.init(args=["x", "--ros-args", *arguments], domain_id=99)
    except Exception:
        return None
    try:
        node = rclpy.create_node("cam", context=context, enable_rosout=False, start_parameter_services=False)
        values = {name: [value.type_.name, written(value.value)] for name, value in node._parameter_overrides.items()}
        node.destroy_node()
        return values
    finally:
        context.try_shutdown()


def test_the_table_holds_for_rclpy(tmp_path):
    rows = json.loads(TABLE.read_text())
    assert len(rows) > 400
    wrong = []
    for i, (words, expected, *_) in enumerate(rows):
        arguments = []
        for j, word in enumerate(words):
            if isinstance(word, dict):
                path = tmp_path / f"{i}_{j}.yaml"
                path.write_bytes(word["file"].encode())
                word = ["--params-file", str(path)]
            arguments += word if isinstance(word, list) else [word]
        got = of_rclpy(arguments)
        if got != expected:
            wrong.append((words, expected, got))
    assert not wrong
