"""Colour images at 640x480 and 60 Hz, both ways, with the profile of Fast DDS that is shipped.

The figures of a longer run on a quiet machine: tests/bench/images/images.py.
"""

import pathlib
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench/images"))
from images import IMAGE, camera_of_node, recorded, table  # noqa: E402

SECONDS = 2
NAME = pytest.mark.parametrize("name", [IMAGE])


@NAME
def test_node_to_rclpy_images(session, name, capsys):
    row = camera_of_node(session, SECONDS)
    with capsys.disabled():
        print("\n" + table({f"{name} to rclpy": row}))
    # Without the profile 80 % are lost and more.
    assert row["sent"] > 30 * SECONDS and row["loss"] < 0.1 and row["p50_ms"] < 100


@NAME
def test_rclpy_to_node_images(session, name, capsys):
    row, _ = recorded(session, name, 60, SECONDS)
    with capsys.disabled():
        print("\n" + table({f"{name} of rclpy": row}))
    assert row["sent"] == 60 * SECONDS and row["loss"] < 0.1 and row["p50_ms"] < 100


def test_the_profiles_are_those_that_the_readme_names():
    root = pathlib.Path(__file__).resolve().parents[2]
    readme = (root / "launch_configs/README.md").read_text()
    for profile in sorted((root / "launch_configs").glob("fastdds_*.xml")):
        assert profile.name in readme
