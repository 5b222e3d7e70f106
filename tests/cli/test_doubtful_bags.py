"""Recordings with bad data: each fault is named once, with topic, time, value and what was expected, and no result that fits
nothing looks like a success.

CATENARY_DATA: measured and failing inputs; what needs them is skipped without.
"""

import json
import os
import pathlib
import sqlite3
import subprocess
import time

import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
MODEL, BAG = ROOT / "launch_configs/models/soft_bar.yaml", ROOT / "bags/swing"
INPUTS = pathlib.Path(os.environ.get("CATENARY_DATA", "nowhere")) / "failing_inputs"
needs_inputs = pytest.mark.skipif(not INPUTS.is_dir(), reason="CATENARY_DATA names no folder with failing_inputs")
QUICK = ("--iterations", 1, "--simulations", 60)
POSE, KEYPOINTS, EVENT = "/panda/current_pose", "/dlo/keypoints", "/episode/event"
MISFIT = 3


def run(*arguments, timeout=300):
    own = {"ROS_DOMAIN_ID": str(20 + os.getpid() % 36), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(command, env=os.environ | own, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=timeout)


def infer(bag, out, *arguments):
    return run("infer", "--bag", bag, "--model", MODEL, "--out", out, *QUICK, *arguments)


def info(bag):
    done = run("info", bag, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def rewrite(out, change, source=BAG, plugin=StoragePlugin.MCAP):
    """The sample bag with messages that `change(topic, number, message)` has changed; the number counts those of the topic."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(source) as reader, Writer(out, version=9, storage_plugin=plugin) as writer:
        for connection in reader.connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            store.register({name: kind for name, kind in types.items() if name not in store.types})
        topics = {
            c.id: writer.add_connection(c.topic, c.msgtype, typestore=store, offered_qos_profiles=c.ext.offered_qos_profiles)
            for c in reader.connections
        }
        counts = {}
        for connection, log_ns, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            number = counts[connection.topic] = counts.get(connection.topic, -1) + 1
            change(connection.topic, number, message)
            writer.write(topics[connection.id], log_ns, store.serialize_cdr(message, connection.msgtype))
    return out


def poses(change):
    """A change of all poses."""
    return lambda topic, number, message: change(number, message) if topic == POSE else None


def refused(done, *says):
    """Asserts one line on stderr that says all of it, each part once, and nothing on stdout."""
    lines = done.stderr.splitlines()
    assert done.returncode == 2 and done.stdout == "" and len(lines) == 1, (done.returncode, done.stdout, done.stderr)
    for part in says:
        assert lines[0].count(part) == 1, (part, lines[0])
    return lines[0]


@needs_inputs
def test_one_impossible_pose_costs_nothing_but_a_warning(tmp_path):
    done = run("infer", "--bag", INPUTS / "pose_zero_one", "--model", MODEL, "--out", tmp_path, "--iterations", 2, "--simulations", 300, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
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
def test_stamps_that_make_no_episode_are_the_first_thing_said(tmp_path, bag, says):
    for command in (infer, lambda *a: run("find-effects", "--bag", a[0], "--model", MODEL, "--out", a[1])):
        line = refused(command(INPUTS / bag, tmp_path), says[0], says[-1])
        assert line.index(says[0]) < line.index(says[-1]) and bag in line and says[1] in line
    (note,) = (n for n in info(INPUTS / bag)["notes"] if says[0] in n)
    assert says[1] in note


@needs_inputs
def test_times_before_1970_are_read_and_replayed_as_they_are():
    said = info(INPUTS / "negts")
    assert (said["start_ns"], said["duration_s"]) == (-9_000_000_000, 4.0)
    started = time.monotonic()
    done = run("replay", INPUTS / "negts", "--topics", POSE, EVENT)
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - started > 4, "replayed in one burst"


def test_negative_times_of_any_database_are_kept(tmp_path):
    bag = rewrite(tmp_path / "bag", lambda *_: None, plugin=StoragePlugin.SQLITE3)
    before = info(bag)
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        # Half of it before 1970.
        middle = before["start_ns"] + int(0.5e9 * before["duration_s"])
        database.execute("UPDATE messages SET timestamp = timestamp - ?", (middle,))
    after = info(bag)
    assert after["start_ns"] == before["start_ns"] - middle < 0
    assert after["duration_s"] == pytest.approx(before["duration_s"]) and after["readable"] == before["readable"]


def test_a_stream_that_cannot_be_right_is_refused_once_by_each_command(tmp_path):
    def in_mm(_, message):
        message.pose.position.x, message.pose.position.z = 1e3 * message.pose.position.x, 1e3 * message.pose.position.z

    bag = rewrite(tmp_path / "bag", poses(in_mm))
    for done in (infer(bag, tmp_path / "a"), run("find-effects", "--bag", bag, "--model", MODEL, "--out", tmp_path / "b")):
        refused(done, "pose.position: expected m", "as if in mm", "episode 7")
    assert any("as if in mm" in note for note in info(bag)["notes"])


def test_a_fault_and_a_foreign_frame_are_named(tmp_path):
    def change(topic, _, message):
        if topic == EVENT and message.event == 1:
            message.reason = "fault: cartesian_reflex"
        if topic == POSE:
            message.header.frame_id = "world"

    bag = rewrite(tmp_path / "bag", change)
    refused(infer(bag, tmp_path / "a"), 'ended with "fault: cartesian_reflex"', "by its number")
    refused(run("find-effects", "--bag", bag, "--model", MODEL, "--out", tmp_path / "b"), "fault: cartesian_reflex")
    done = infer(bag, tmp_path / "a", "--episode", 7, "--json")
    warnings = json.loads(done.stdout)["warnings"]
    for words in ('expected "panda_link0", got "world" in 206 poses', "fault: cartesian_reflex"):
        assert sum(words in w for w in warnings) == 1, warnings


def test_a_result_that_fits_nothing_has_its_own_exit_code_and_says_so_first(tmp_path):
    def elsewhere(_, message):
        message.pose.position.x += 0.25

    bag, out = rewrite(tmp_path / "bag", poses(elsewhere)), tmp_path / "out"
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
