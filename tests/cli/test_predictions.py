"""Predictions of recordings that an inference has not seen: `infer --predict`."""

import json

import pytest

from support.program import MODEL

QUICK = ("--preset", "networks", "--iterations", 4, "--simulations", 60)
ROWS = {"right": [(0.03, 0.0)] * 3 + [(-0.03, 0.01)] * 3, "up": [(0.0, 0.03)] * 4 + [(0.02, -0.03)] * 2, "far": [(0.04, -0.01)] * 4}


@pytest.fixture(scope="module")
def bags(program, tmp_path_factory):
    """Bags of one object in three motions."""
    folder = tmp_path_factory.mktemp("bags")
    for seed, (name, rows) in enumerate(ROWS.items()):
        actions = folder / f"{name}.csv"
        actions.write_text("dx_m,dz_m\n" + "".join(f"{x},{z}\n" for x, z in rows))
        truth = ("--theta", "length_m=0.25", "--theta", "youngs_modulus_pa=5000")
        program.text("simulate", "--model", MODEL, "--actions", actions, *truth, "--noise", "--seed", seed, "--out", folder / name)
    return folder


def test_a_posterior_predicts_recordings_that_it_has_not_seen(program, bags, tmp_path):
    asked = ("--predict", bags / "up", "--predict", bags / "far")
    report = program.json("infer", bags / "right", "--model", MODEL, "--out", tmp_path, *asked, *QUICK, seconds=300)
    assert json.loads((tmp_path / "inference.json").read_text()) == report
    assert [p["bag"] for p in report["predictions"]] == [str(bags / "up"), str(bags / "far")]
    for p in report["predictions"]:
        # The object is 250 mm long.
        assert 0 < p["rmse_mm"] < 100 and p["half_width_mm"] > p["noise_half_width_mm"] > 0
        # Networks after a few simulations are wide, so that their bands hold the recording.
        assert p["coverage"] > 0.7 and 0 < p["coverage_50"] <= p["coverage"]
        assert abs(sum(p["shares"][part] for part in ("parameters", "episode", "noise")) - 1) < 1e-9
    page = (tmp_path / "report.html").read_text()
    assert "Recordings that the fit has not seen" in page and page.count("Drawn anew for it") == 2


def test_a_recording_of_the_fit_and_a_running_graph_are_refused(program, bags, tmp_path):
    asked = ("infer", bags / "right", "--model", MODEL, "--out", tmp_path, "--predict", bags / "right")
    done = program(*asked)
    assert done.returncode == 2 and "that the inference does not see" in done.stderr, done.stderr
    done = program(*asked, "--node")
    lines = done.stderr.splitlines()
    assert done.returncode == 2 and len(lines) == 1 and "--predict: expected an inference in this process" in lines[0], done.stderr
    done = program(*asked[:-2], "--predict-episode", 1)
    assert done.returncode == 2 and "--predict" in done.stderr, done.stderr
