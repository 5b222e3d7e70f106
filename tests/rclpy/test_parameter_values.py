"""The table of types and values that tests our reader of parameters (files and -p) holds for rclpy."""

import json

from support.given_parameters import of_rclpy
from support.program import ROOT

TABLE = ROOT / "nodes/ros/shell/src/parameters/args/rcl.json"


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
