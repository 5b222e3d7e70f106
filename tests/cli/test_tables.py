"""Measured tables and their fit: `import-track` names bad rows by file, column and line, and `infer` names where a model is off.

CATENARY_DATA: folder with measured_cable_2; tests that need it are skipped without.
"""

import json
import math
import os
import pathlib

import pytest

from support.bags import rewritten
from support.program import MODEL, MODELS

CABLE = MODELS / "measured_cable.yaml"
DATA = pathlib.Path(os.environ.get("CATENARY_DATA", "nowhere")) / "measured_cable_2"
HEADER = "t_s,grip_x_m,grip_z_m,grip_pitch_rad," + ",".join(f"p{k}_{axis}_m" for k in range(1, 5) for axis in "xz") + "\n"
WRONG_INPUT = 2


def row(number):
    """Row of an object of 0.4 m that swings below a hand that moves along x, at 30 Hz."""
    time_s = number / 30
    x, angle = 0.05 * math.sin(2 * time_s), 0.3 * math.cos(5 * time_s)
    points = [(x + 0.1 * k * math.sin(angle * k / 4), 0.7 - 0.1 * k * math.cos(angle * k / 4)) for k in range(1, 5)]
    return [time_s, x, 0.7, 0.0, *(v for point in points for v in point)]


@pytest.fixture
def table(tmp_path):
    """Writes a table of 90 rows, each changed by `change(number, row)`; returns its path."""

    def write(change=lambda number, row: None):
        rows = [row(number) for number in range(90)]
        for number, values in enumerate(rows):
            change(number, values)
        path = tmp_path / "track.csv"
        path.write_text(HEADER + "".join(",".join(f"{v:.6f}" for v in values) + "\n" for values in rows))
        return path

    return write


@pytest.fixture
def imported(program, tmp_path):
    """Imports a table; returns the CompletedProcess."""
    return lambda path, *arguments: program("import-track", path, "--model", CABLE, "--out", tmp_path / "bag", *arguments)


def test_a_good_table_has_no_warning(table, imported):
    done = imported(table(), "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["warnings"] == []


def test_held_rows_zeros_and_points_out_of_view_are_named_by_line(table, imported):
    held = row(49)

    def change(number, values):
        if number >= 50:
            values[4:] = held[4:]
        if number == 10:
            values[8:10] = [0, 0]
        if 20 <= number < 23:
            values[10] += 0.7

    done = imported(table(change))
    assert done.returncode == 0 and done.stderr == ""
    warnings = [line.removeprefix("warning: ") for line in done.stdout.splitlines() if line.startswith("warning: ")]
    zeros, view, repeats = warnings
    assert "track.csv: columns p3_x_m, p3_z_m: (0, 0) in 1 of 90 rows, line 12" in zeros
    assert "keypoint 4 beyond the right edge in 3 of 89 frames, the first in line 22" in view and "side_m" in view
    assert "40 of 90 rows (44 %) hold" in repeats and "lines 52 to 91" in repeats and "left out" in repeats


@pytest.mark.parametrize(("factor", "unit"), [(1000, "as if in milliseconds: divide"), (0.001, "as if in seconds divided by 1000")])
def test_times_in_another_unit_are_refused_in_one_line(table, imported, tmp_path, factor, unit):
    def change(_, values):
        values[0] *= factor

    done = imported(table(change))
    (line,) = done.stderr.splitlines()
    assert done.returncode == WRONG_INPUT and done.stdout == "" and not (tmp_path / "bag").exists()
    for part in ("track.csv: lines 2 to 91, column t_s", "about 0.033 s apart", unit):
        assert line.count(part) == 1, (part, line)


@pytest.mark.skipif(not DATA.is_dir(), reason="CATENARY_DATA names no folder with measured_cable_2")
def test_the_frozen_end_of_a_measured_swing_is_named(imported):
    done = imported(DATA / "swing_bare.csv", "--json")
    (warning,) = json.loads(done.stdout)["warnings"]
    assert "66 of 108 rows (61 %) hold" in warning and "the longest run 55, lines 55 to 109" in warning


def test_a_model_that_is_off_is_named_with_keypoint_time_and_share_in_the_band(program, tmp_path):
    def displaced(topic, _, message):
        # The hand of the recording is 8 cm beside the hand that held the object.
        if topic == "/panda/current_pose":
            message.pose.position.x += 0.08

    bag, out = rewritten(tmp_path / "bag", displaced), tmp_path / "out"
    done = program(
        "infer", bag, "--model", MODEL, "--out", out, "--preset", "networks", "--iterations", 2, "--simulations", 200, "--json", seconds=300
    )
    report = json.loads(done.stdout)
    (warning,) = (w for w in report["warnings"] if w.startswith("the model reproduces the recording poorly: RMSE"))
    parts = report["predictive"]["parts"]
    assert [(p["third"], p["keypoint"]) for p in parts] == [(third, k) for third in (1, 2, 3) for k in (1, 2, 3, 4)]
    worst = max(parts, key=lambda part: part["deviations"])
    place = f"worst: keypoint {worst['keypoint']} from the grip, {worst['times_s'][0]:.2f} s to {worst['times_s'][1]:.2f} s"
    assert f"{place} (third {worst['third']} of 3), RMSE {worst['rmse_mm']:.1f} mm" in warning
    page = (out / "report.html").read_text()
    assert page.count("<td>worst</td>") == 1 and "Keypoints are counted from the grip" in page
