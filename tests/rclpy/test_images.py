"""Colour images of 640x480 at 60 Hz, to and from rclpy, with the shipped profile of Fast DDS.

The bench tests/bench/images/images.py gives figures of a longer run.
"""

import sys

import pytest

from support.program import ROOT

sys.path.insert(0, str(ROOT / "tests/bench/images"))
from images import IMAGE, camera_of_node, recorded, table

SECONDS = 2
NAME = pytest.mark.parametrize("name", [IMAGE])


@NAME
def test_node_to_rclpy_images(session, name, capsys):
    row = camera_of_node(session, SECONDS)
    with capsys.disabled():
        print("\n" + table({f"{name} to rclpy": row}))
    # Without the profile more than 80 % are lost.
    assert row["sent"] > 30 * SECONDS and row["loss"] < 0.1 and row["p50_ms"] < 100


@NAME
def test_rclpy_to_node_images(session, name, capsys):
    row, _ = recorded(session, name, 60, SECONDS)
    with capsys.disabled():
        print("\n" + table({f"{name} of rclpy": row}))
    assert row["sent"] == 60 * SECONDS and row["loss"] < 0.1 and row["p50_ms"] < 100


def test_the_readme_names_every_profile():
    readme = (ROOT / "launch_configs/README.md").read_text()
    for profile in sorted((ROOT / "launch_configs").glob("fastdds_*.xml")):
        assert profile.name in readme
