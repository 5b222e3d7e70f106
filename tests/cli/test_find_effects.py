"""`catenary find-effects` on a bag of a simulated episode: its output, its files and its end."""

import json
import pathlib
import re
import shutil
import signal
import time

import pytest

from support.program import MODEL, MODELS, ROOT
from support.waiting import wait_for


@pytest.fixture(scope="module")
def bag(program, tmp_path_factory):
    """Bag with an episode of the soft bar, measured with noise."""
    bag = tmp_path_factory.mktemp("episode") / "bag"
    program.text("simulate", "--model", MODEL, "--actions", MODELS / "gallery.csv", "--noise", "--seed", 3, "--out", bag)
    return bag


def command(bag, out, *arguments, model=MODEL):
    # 19 null sets: the fewest with which a p-value reaches 0.05.
    return ["find-effects", "--bag", bag, "--model", model, "--out", out, "--null-sets", 19, *arguments]


@pytest.fixture(scope="module")
def whole(program, bag, tmp_path_factory):
    """Folder, CompletedProcess and document of an uninterrupted search in the bag."""
    folder = tmp_path_factory.mktemp("whole") / "found"
    done = program(*command(bag, folder, "--json"), seconds=300)
    assert done.returncode == 0 and not (folder / "search.journal").exists(), done.stderr
    return folder, done, json.loads(done.stdout)


def test_a_model_that_explains_its_own_episode_has_no_gap(bag, whole):
    found, done, said = whole
    assert said == json.loads((found / "verdict.json").read_text())
    assert said["verdict"] == "no_gap" and said["found"] == [] and said["repaired"] is None
    assert said["episodes"] == [{"bag": str(bag), "number": 1}]
    assert len(said["present"]["test"]["null"]) == 19 and said["present"]["test"]["p_value"] > 0.05
    assert done.stderr.count("\n") >= 2 and "detect: the residual is noise" in done.stderr
    assert (found / "model.yaml").read_text() == MODEL.read_text()
    page = (found / "report/index.html").read_text()
    # Figures of measured and predicted keypoints, of the parts of the data and of the null sets; then detectable sizes.
    assert (
        "no_gap" in page and "nothing that it could show is missing" in page and page.count("<figure>") > 3 and "Detectable sizes" in page
    )
    sizes = {limit["name"]: limit["size"] for limit in said["limits"]}
    assert 0 < sizes["tip_mass_kg"] < 0.006 and None in sizes.values()


@pytest.mark.parametrize("option", ["--bag", "--validate", "--verify"])
def test_an_episode_judges_no_fit_of_its_own(program, bag, tmp_path, option):
    copy = shutil.copytree(bag, tmp_path / "copy")
    done = program(*command(bag, tmp_path / "out", option, copy))
    assert done.returncode == 2 and done.stdout == "" and not (tmp_path / "out").exists()
    assert "episodes: expected each episode once, got bag, episode 1 and copy, episode 1" in done.stderr


def test_a_hidden_mass_is_named_and_verified_on_an_unseen_episode(hidden_mass):
    folder, done = hidden_mass
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert ["tip_mass_kg"] in [alike[:1] for alike in said["found"]], said["conclusions"]
    check = said["verification"]
    assert check["after"]["rmse_mm"] < check["before"]["rmse_mm"]
    # Without validation episodes those to verify choose, too.
    assert (said["validation"], said["held_out"]) == ([{"bag": str(folder / "unseen/bag"), "number": 1}], [])
    assert "tip_mass_kg" in (folder / "found/model.yaml").read_text()
    page = (folder / "found/report/index.html").read_text()
    # Both bags have one name, and in each the episode has the number 1.
    for words in (
        "noise floor",
        "Fitted (fitted/bag, episode 1)",
        "Not fitted (unseen/bag, episode 1)",
        "Probability of each explanation",
        "Tip mass of",
    ):
        assert words in page, words
    assert "validation episodes" in done.stderr
    told = (ROOT / "nodes/method/effect_finder/VERDICT.md").read_text()
    untold = {key for key in fields({k: v for k, v in said.items() if k != "settings"}) if f"`{key}`" not in told}
    assert not untold, untold


def fields(value):
    """Names of all fields of a JSON document."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else []
    return set(value if isinstance(value, dict) else ()).union(*map(fields, inner))


def test_an_unknown_veto_in_the_model_is_named(refusal, bag, tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text(MODEL.read_text() + "lacking:\n  vetoes: [gremlins]\n")
    said = refusal(bag, tmp_path / "a", model=model)
    assert "lacking.vetoes" in said and "gremlins" in said


def started(program, bag, out):
    """Starts a search; returns its process and journal when the journal holds some simulated answers."""
    child, journal = program.start(*command(bag, out)), out / "search.journal"

    def has_answers():
        assert child.poll() is None, "the search ended by itself"
        return journal.exists() and journal.stat().st_size > 200_000

    wait_for(has_answers, 60, "answers in the journal", pause=lambda: time.sleep(0.01))
    return child, journal


def test_ctrl_c_ends_a_search(program, bag, tmp_path):
    child, journal = started(program, bag, tmp_path / "found")
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert child.returncode == 130 and "to go on: the same command" in err and out == ""
    assert journal.exists() and not (tmp_path / "found/verdict.json").exists()


def test_a_killed_search_goes_on_and_ends_with_the_same_bits(program, bag, whole, tmp_path):
    _, uninterrupted, expected = whole
    assert "resumes" not in uninterrupted.stderr
    child, journal = started(program, bag, tmp_path / "cut")
    child.kill()
    child.communicate()
    # The kill may cut the journal anywhere: the last entry is incomplete.
    with journal.open("ab") as file:
        file.write(b"half an answer")
    done = program(*command(bag, tmp_path / "cut", "--json"), seconds=300)
    assert done.returncode == 0 and not journal.exists(), done.stderr
    assert int(re.search(r"resumes with (\d+) answers", done.stderr)[1]) > 0
    assert json.loads(done.stdout) | {"wall_s": None} == expected | {"wall_s": None}


def test_a_search_begins_anew_beside_the_journal_of_another_and_says_so(program, bag, tmp_path):
    child, journal = started(program, bag, tmp_path / "found")
    child.kill()
    child.communicate()
    other = program.start(*command(bag, tmp_path / "found", "--seed", 2))
    said = other.stderr.readline()
    other.kill()
    other.communicate()
    assert f"{journal}: the answers of another search; this one starts over" in said


@pytest.fixture
def refusal(program):
    """Runs a search that has to be refused; returns its stderr."""

    def run(*arguments, model=MODEL):
        done = program(*command(*arguments, model=model), seconds=60)
        assert done.returncode != 0
        return done.stderr

    return run


def test_a_search_that_cannot_be_made_is_refused_with_the_reason(refusal, bag, tmp_path):
    assert "null-sets" in refusal(bag, tmp_path / "a", "--null-sets", 3)
    assert "/nowhere" in refusal(pathlib.Path("/nowhere"), tmp_path / "a")
    sharp = tmp_path / "sharp.yaml"
    sharp.write_text(MODEL.read_text().replace("keypoint_noise_px: 0.7", "keypoint_noise_px: 0.0"))
    assert "keypoint_noise_px: expected more than 0" in refusal(bag, tmp_path / "a", model=sharp)
