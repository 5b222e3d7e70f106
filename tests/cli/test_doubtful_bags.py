"""Recordings with bad data: each fault is named once with topic, time, value and expected value, and a misfit is no success.

CATENARY_DATA: folder with failing_inputs; tests that need it are skipped without.
"""

import json
import os
import pathlib
import sqlite3
import time

import pytest
from rosbags.rosbag2 import StoragePlugin

from support.bags import rewritten
from support.program import BAG, MODEL

INPUTS = pathlib.Path(os.environ.get("CATENARY_DATA", "nowhere")) / "failing_inputs"
needs_inputs = pytest.mark.skipif(not INPUTS.is_dir(), reason="CATENARY_DATA names no folder with failing_inputs")
# Small sizes with which a sound recording still gets a posterior that fits.
QUICK = ("--preset", "networks", "--iterations", 1, "--simulations", 60)
POSE, KEYPOINTS, EVENT = "/panda/current_pose", "/dlo/keypoints", "/episode/event"
# Exit code of a result that does not fit the recording.
MISFIT = 3


@pytest.fixture
def infer(program):
    """Runs a quick inference from a bag into a folder; returns the CompletedProcess."""
    files = lambda bag, out: ("--bag", bag, "--model", MODEL, "--out", out)
    return lambda bag, out, *arguments: program("infer", *files(bag, out), *QUICK, *arguments, seconds=300)


@pytest.fixture
def find_effects(program):
    """Runs a search for effects in a bag; returns the CompletedProcess."""
    return lambda bag, out: program("find-effects", "--bag", bag, "--model", MODEL, "--out", out, seconds=300)


@pytest.fixture
def info(program):
    """Document that `catenary info` prints for a bag."""
    return lambda bag: program.json("info", bag)


def poses(change):
    """Change for `rewritten` that changes all poses by `change(number, message)`."""
    return lambda topic, number, message: change(number, message) if topic == POSE else None


def refused(done, *says):
    """Asserts one line on stderr that holds each part of `says` once, and nothing on stdout; returns the line."""
    lines = done.stderr.splitlines()
    assert done.returncode == 2 and done.stdout == "" and len(lines) == 1, (done.returncode, done.stdout, done.stderr)
    for part in says:
        assert lines[0].count(part) == 1, (part, lines[0])
    return lines[0]


@needs_inputs
def test_one_impossible_pose_is_left_out_with_a_warning(program, info, tmp_path):
    sizes = ("--preset", "networks", "--iterations", 2, "--simulations", 300)
    report = program.json("infer", "--bag", INPUTS / "pose_zero_one", "--model", MODEL, "--out", tmp_path, *sizes, seconds=300)
    length = report["marginals"][0]
    assert length["q05"] < 0.243 < length["q95"] and report["predictive"]["rmse_mm"] < 20 and report["fits"]
    (warning,) = (w for w in report["warnings"] if w.startswith(POSE))
    assert "1 of 801 poses left out" in warning and "position (0, 0, 0) m" in warning and "stamp" in warning
    assert any("1 of 801 poses left out" in note for note in info(INPUTS / "pose_zero_one")["notes"])
    assert "1 of 801 poses left out" in (tmp_path / "report.html").read_text()


@needs_inputs
@pytest.mark.parametrize(
    ("bag", "says"),
    [
        ("zero_stamps", ("241 keypoints and 801 poses have the stamp 0", "use_sim_time", "no complete episode")),
        ("step_back_1h", ("the end of episode 1 is stamped 3596.000 s before its start", "clock", "no complete episode")),
    ],
)
def test_stamps_that_make_no_episode_are_the_first_thing_said(infer, find_effects, info, tmp_path, bag, says):
    for command in (infer, find_effects):
        line = refused(command(INPUTS / bag, tmp_path), says[0], says[-1])
        assert line.index(says[0]) < line.index(says[-1]) and bag in line and says[1] in line
    (note,) = (n for n in info(INPUTS / bag)["notes"] if says[0] in n)
    assert says[1] in note


@needs_inputs
def test_times_before_1970_are_read_and_replayed_as_they_are(program, info):
    said = info(INPUTS / "negts")
    assert (said["start_ns"], said["duration_s"]) == (-9_000_000_000, 4.0)
    started = time.monotonic()
    program.text("replay", INPUTS / "negts", "--topics", POSE, EVENT, "--rate", 4)
    assert time.monotonic() - started > 1, "replayed in one burst"


def test_negative_times_of_any_database_are_kept(info, tmp_path):
    bag = rewritten(tmp_path / "bag", plugin=StoragePlugin.SQLITE3)
    before = info(bag)
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        # Moves the middle of the bag to 1970, so that half of its times are negative.
        middle = before["start_ns"] + int(0.5e9 * before["duration_s"])
        database.execute("UPDATE messages SET timestamp = timestamp - ?", (middle,))
    after = info(bag)
    assert after["start_ns"] == before["start_ns"] - middle < 0
    assert after["duration_s"] == pytest.approx(before["duration_s"]) and after["readable"] == before["readable"]


def test_a_stream_in_another_unit_is_refused_by_each_command_in_one_line(infer, find_effects, info, tmp_path):
    def in_mm(_, message):
        message.pose.position.x, message.pose.position.z = 1e3 * message.pose.position.x, 1e3 * message.pose.position.z

    bag = rewritten(tmp_path / "bag", poses(in_mm))
    for done in (infer(bag, tmp_path / "a"), find_effects(bag, tmp_path / "b")):
        refused(done, "pose.position: expected m", "as if in mm", "episode 7")
    assert any("as if in mm" in note for note in info(bag)["notes"])


def test_a_fault_and_a_foreign_frame_are_named(infer, find_effects, tmp_path):
    def change(topic, _, message):
        if topic == EVENT and message.event == 1:
            message.reason = "fault: cartesian_reflex"
        if topic == POSE:
            message.header.frame_id = "world"

    bag = rewritten(tmp_path / "bag", change)
    refused(infer(bag, tmp_path / "a"), 'ended with "fault: cartesian_reflex"', "the number of an episode")
    refused(find_effects(bag, tmp_path / "b"), "fault: cartesian_reflex")
    done = infer(bag, tmp_path / "a", "--episode", 7, "--json")
    warnings = json.loads(done.stdout)["warnings"]
    for words in ('expected "panda_link0", got "world" in 206 poses', "fault: cartesian_reflex"):
        assert sum(words in w for w in warnings) == 1, warnings


def test_a_misfit_has_its_own_exit_code_and_is_said_first(infer, tmp_path):
    def elsewhere(_, message):
        message.pose.position.x += 0.25

    bag, out = rewritten(tmp_path / "bag", poses(elsewhere)), tmp_path / "out"
    done = infer(bag, out, "--json")
    assert done.returncode == MISFIT, (done.returncode, done.stderr)
    report = json.loads(done.stdout)
    assert report["fits"] is False and "mm off the measured keypoints" in report["misfit"]
    assert json.loads((out / "posterior.json").read_text()) == report["posterior"]
    assert json.loads((out / "inference.json").read_text()) == report
    assert "does not fit the recording" in (out / "report.html").read_text()
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("catenary: the result") and str(out) in lines[0]
    done = infer(bag, out)
    assert done.returncode == MISFIT and done.stdout.startswith("DOES NOT FIT the recording: "), done.stdout
    fine = infer(BAG, tmp_path / "fine", "--json")
    assert fine.returncode == 0 and json.loads(fine.stdout)["fits"] is True
