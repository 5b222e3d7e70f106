"""`catenary find-effects` on a bag of a simulated episode: what it prints and writes, and how it ends."""

import json
import pathlib
import re
import signal
import subprocess
import time

import pytest
from conftest import PROGRAM, ROOT

MODEL = ROOT / "launch_configs/models/soft_bar.yaml"
ACTIONS = ROOT / "launch_configs/models/gallery.csv"


def simulate(folder, *arguments):
    """A bag with an episode of the soft bar, measured with noise."""
    folder.mkdir(exist_ok=True)
    command = [PROGRAM, "simulate", "--model", MODEL, "--actions", ACTIONS, "--noise", "--out", folder / "bag", *(arguments or ("--seed", "3"))]
    subprocess.run(list(map(str, command)), check=True, capture_output=True, timeout=120)
    return folder / "bag"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("episode"))


def command(bag, out, *arguments, model=MODEL):
    return [str(a) for a in (PROGRAM, "find-effects", "--bag", bag, "--model", model, "--out", out, "--null-sets", 19, *arguments)]


def test_a_model_that_explains_its_own_episode_has_no_gap(bag, tmp_path):
    done = subprocess.run(command(bag, tmp_path / "found", "--json"), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said == json.loads((tmp_path / "found/verdict.json").read_text())
    assert said["verdict"] == "no_gap" and said["found"] == [] and said["repaired"] is None
    assert said["episodes"] == [{"bag": str(bag), "number": 1}]
    assert len(said["present"]["test"]["null"]) == 19 and said["present"]["test"]["p_value"] > 0.05
    assert done.stderr.count("\n") >= 2 and "detect: what is left is noise" in done.stderr
    assert (tmp_path / "found/model.yaml").read_text() == MODEL.read_text()
    page = (tmp_path / "found/report/index.html").read_text()
    # Keypoints with what is predicted, the parts of the data, and the null sets; of effects, from which size they would have shown.
    assert "no_gap" in page and "nothing is missing" in page and page.count("<figure>") > 3 and "What would have shown" in page
    sizes = {limit["name"]: limit["size"] for limit in said["limits"]}
    assert 0 < sizes["tip_mass_kg"] < 0.006 and None in sizes.values()


def test_a_hidden_mass_is_named_and_verified_on_an_unseen_episode(hidden_mass):
    folder, done = hidden_mass
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert ["tip_mass_kg"] in [alike[:1] for alike in said["found"]], said["conclusions"]
    check = said["verification"]
    assert check["after"]["rmse_mm"] < check["before"]["rmse_mm"] and said["held_out"] == [{"bag": str(folder / "unseen/bag"), "number": 1}]
    assert "tip_mass_kg" in (folder / "found/model.yaml").read_text()
    page = (folder / "found/report/index.html").read_text()
    assert all(words in page for words in ("noise floor", "Held-out episode 0", "Probability of each explanation", "Tip mass of")), page[:500]
    assert "unseen episodes" in done.stderr
    told = (ROOT / "nodes/effect_finder/VERDICT.md").read_text()
    untold = {key for key in fields({k: v for k, v in said.items() if k != "settings"}) if f"`{key}`" not in told}
    assert not untold, untold


def fields(value):
    """Names of all fields of a JSON document."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else []
    return set(value if isinstance(value, dict) else ()).union(*map(fields, inner))


def test_vetoes_and_odds_are_read_from_the_model(bag, tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text(MODEL.read_text() + "lacking:\n  vetoes: [gremlins]\n")
    assert "lacking.vetoes" in refusal(bag, tmp_path / "a", model=model) and "gremlins" in refusal(bag, tmp_path / "a", model=model)


def started(bag, out):
    """A search that has kept some of what was simulated."""
    child = subprocess.Popen(command(bag, out), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    journal, deadline = out / "search.journal", time.monotonic() + 60
    while not journal.exists() or journal.stat().st_size < 200_000:
        assert child.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    return child, journal


def test_ctrl_c_ends_a_search(bag, tmp_path):
    child, journal = started(bag, tmp_path / "found")
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert child.returncode == 130 and "the same command goes on from there" in err and out == ""
    assert journal.exists() and not (tmp_path / "found/verdict.json").exists()


def test_a_killed_search_goes_on_and_ends_with_the_same_bits(bag, tmp_path):
    def finish(out):
        done = subprocess.run(command(bag, out, "--json"), capture_output=True, text=True, timeout=300)
        assert done.returncode == 0 and not (out / "search.journal").exists(), done.stderr
        return {key: value for key, value in json.loads(done.stdout).items() if key != "wall_s"}, done.stderr

    whole, err = finish(tmp_path / "whole")
    assert "goes on" not in err
    child, journal = started(bag, tmp_path / "cut")
    child.kill()
    child.communicate()
    with journal.open("ab") as file:
        file.write(b"half an answer")
    rest, err = finish(tmp_path / "cut")
    assert int(re.search(r"goes on with (\d+) answers", err)[1]) > 0 and rest == whole


def refusal(*arguments, model=MODEL):
    done = subprocess.run(command(*arguments, model=model), capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    return done.stderr


def test_what_cannot_be_searched_is_named(bag, tmp_path):
    assert "--null-sets" in refusal(bag, tmp_path / "a", "--null-sets", 3) or "null-sets" in refusal(bag, tmp_path / "a", "--null-sets", 3)
    assert "/nowhere" in refusal(pathlib.Path("/nowhere"), tmp_path / "a")
    sharp = tmp_path / "sharp.yaml"
    sharp.write_text(MODEL.read_text().replace("keypoint_noise_px: 0.7", "keypoint_noise_px: 0.0"))
    assert "keypoint_noise_px: expected more than 0" in refusal(bag, tmp_path / "a", model=sharp)
