"""Small blind test: three programs draw and seal, search, and score three worlds."""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys

import draw
import numpy
import pytest
import score
from alone import alone

HERE = pathlib.Path(__file__).parent


def run(name, *arguments):
    return subprocess.run([sys.executable, HERE / name, *map(str, arguments)], capture_output=True, text=True, timeout=900)


@pytest.fixture(scope="module")
def worlds(tmp_path_factory):
    """One world without an effect and one of each of two effects, at three detectable sizes, searched.

    With seed 2 both effects are found, which not every draw gives.
    """
    folder = tmp_path_factory.mktemp("blind")
    kinds = ("--nulls", 1, "--each", 1, "--pairs", 0, "--unlisted", 0)
    drawing = (*kinds, "--effects", "tip_mass_kg,camera_tilt_rad", "--sizes", 3, "--seed", 2)
    for name, arguments in (("draw.py", drawing), ("find.py", ("--null-sets", 19))):
        done = run(name, "--out", folder, *arguments)
        assert done.returncode == 0, done.stderr
    return folder


def test_bags_hold_topics_and_no_answer(worlds):
    for world in (worlds / "worlds").iterdir():
        assert sorted(p.name for p in world.iterdir()) == ["bag_0", "bag_1", "model.yaml"]
        answer = json.loads((worlds / "sealed" / f"{world.name}.json").read_text())
        told = (world / "model.yaml").read_text()
        assert all(name not in told for name in answer["hidden"])


def test_hidden_effects_are_named_and_nothing_is_where_nothing_was_hidden(worlds):
    done = run("score.py", "--out", worlds, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["worlds"] == 3 and found["false_alarms"]["share"] == 0.0
    assert found["sizes"]["3.0"]["detected"]["share"] == 1.0 and found["sizes"]["3.0"]["group"]["share"] == 1.0, found
    assert found["gap_closed"]["3.0"] > 0.6
    assert (worlds / "score.png").stat().st_size > 10_000


def test_objects_of_each_kind_are_among_the_worlds_without_an_effect(tmp_path):
    drawn = [draw.setting_of(stream, 0.0, [], [], argparse.Namespace(seed=1), tmp_path) for stream in range(2 * len(draw.OBJECTS))]
    assert [setting["object"] for setting in drawn] == 2 * list(range(len(draw.OBJECTS)))
    for setting in drawn:
        _, softest, stiffest = draw.OBJECTS[setting["object"]]
        assert softest <= setting["theta"]["youngs_modulus_pa"] <= stiffest


def test_searches_draw_noise_of_their_own(worlds):
    tests = [json.loads(path.read_text())["settings"]["seed"] for path in (worlds / "found").glob("*/verdict.json")]
    assert len(tests) == 3 and len(set(tests)) == 3, tests


def test_rows_of_other_worlds_count_too(worlds, tmp_path):
    rows = run("score.py", "--out", worlds, "--rows")
    assert rows.returncode == 0, rows.stderr
    first, *_ = lines = [json.loads(line) for line in rows.stdout.splitlines()]
    assert len(lines) == 3 and len({line["number"] for line in lines}) == 3
    others = tmp_path / "rows.jsonl"
    missing = {"seed": 7, "number": 0, "kind": "left_out", "size": 3.0, "hidden": ["tip_mass_kg"], "why": "shows nowhere"}
    others.write_text("".join(json.dumps(row) + "\n" for row in (first, first | {"seed": first["seed"] + 1}, missing)))
    done = run("score.py", "--out", worlds, "--measured", others, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["worlds"] == 4 and found["left_out"] == {"tip_mass_kg": 1}
    assert found["effects"]["tip_mass_kg"]["3.0"]["left_out"] == 1


def test_wrong_answers_are_counted(worlds, tmp_path):
    rows = [json.loads(line) for line in run("score.py", "--out", worlds, "--rows").stdout.splitlines()]
    row = next(row for row in rows if row["hidden"] == ["tip_mass_kg"])
    wrong = {"verdict": "named", "found": [["density_change"]], "top_1": False}
    missed = {"verdict": "no_gap", "found": [], "top_1": False}
    unlisted, pair = wrong | {"kind": "unlisted", "hidden": ["soft_joint"]}, missed | {"kind": "pair"}
    others = [row, row | wrong, row | wrong, row | missed, row | unlisted, row | pair]
    path = tmp_path / "rows.jsonl"
    path.write_text("".join(json.dumps(one | {"seed": 8, "number": i}) + "\n" for i, one in enumerate(others)))
    done = run("score.py", "--out", tmp_path, "--measured", path)
    assert done.returncode == 0, done.stderr
    assert "of 4, density_change 2, no_gap 1 |" in done.stdout and "soft_joint  0% of 1 (0% to 79%), density_change 1" in done.stdout
    found = json.loads((tmp_path / "score.json").read_text())["summary"]
    assert found["each_pair"]["tip_mass_kg"]["instead"] == {"no_gap": 1} and found["effects"]["tip_mass_kg"]["3.0"]["held"][1]["of"] == 1


def test_two_programs_do_not_work_in_one_folder(worlds, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(worlds, copy, ignore=shutil.ignore_patterns("bag_*"))
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    with alone(copy):
        for name in ("draw.py", "find.py"):
            done = run(name, "--out", copy)
            assert done.returncode == 1 and f"{copy}: expected to be alone there" in done.stderr
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before


def test_an_answer_that_was_changed_after_it_was_sealed_is_refused(worlds, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(worlds, copy, ignore=shutil.ignore_patterns("bag_*"))
    answer = next((copy / "sealed").iterdir())
    answer.write_text(answer.read_text() + " ")
    done = run("score.py", "--out", copy)
    assert done.returncode != 0 and "does not match its seal" in done.stderr


def test_figures_of_the_score_have_closed_forms():
    low, high = score.wilson(5, 100)
    assert abs(low - 0.0215) < 5e-4 and abs(high - 0.1118) < 5e-4
    assert score.wilson(0, 10)[0] == 0.0 and score.wilson(0, 0) == [0.0, 1.0]
    even = (numpy.arange(100) + 0.5) / 100
    assert score.kolmogorov_p(even) > 0.99 and score.kolmogorov_p(even**2) < 1e-4
    # Uniform p-values: each of the steps 1 / 200 to 1 once, and each of the steps 1 / 20 to 1 once.
    tests = [{"p": (i + 1) / (n + 1), "null_sets": n} for n in (19, 199) for i in range(n + 1)]
    for p, row in zip(score.spread(tests), tests, strict=True):
        assert 0.0 <= p <= row["p"] and row["p"] - p <= 1 / (1 + row["null_sets"])
    assert score.kolmogorov_p(score.spread(tests)) > 0.99
    row = {"kind": "effect", "probabilities": [(0.9, True)] * 9 + [(0.9, False)]}
    assert score.calibration([row])[0] < 1e-9
