"""`catenary train-tracker` makes weights that `mask` and `simulate --eyes` take; wrong ones are refused by name."""

import numpy
import pytest
import yaml

ACTIONS = "dx_m,dz_m\n0.03,-0.02\n-0.04,0.0\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("tracker")
    (path / "actions.csv").write_text(ACTIONS)
    return path


def eyes(folder, name, **camera):
    nodes = {"camera": {"ros__parameters": camera or {"segmenter": "colour"}}}
    nodes["keypoint_tracker"] = {"ros__parameters": {"tracker": name}}
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump(nodes))
    return file


@pytest.mark.parametrize("tracker", ["ordered", "transporter"])
def test_a_training_makes_weights_and_says_where_the_keypoints_lie(program, folder, tracker):
    trained = program.json(
        "train-tracker", "--tracker", tracker, "--rollouts", 3, "--steps", 2, "--out", "w.bin", folder=folder, seconds=300
    )
    places = trained["places"]
    assert trained["steps"] == 2 and trained["rollouts"] == 3 and numpy.isfinite(trained["loss"])
    assert len(places["fractions"]) == 4 and sorted(places["fractions"]) == places["fractions"]
    assert (trained["ordered"] is None) == (tracker == "transporter")
    again = program.json("train-tracker", "--tracker", tracker, "--measure", "w.bin", folder=folder, seconds=300)
    assert again["places"] == places and again["ordered"] == trained["ordered"]
    shipped = program.json("train-tracker", "--tracker", tracker, "--measure", folder=folder, seconds=300)
    assert shipped["places"] != places
    file = eyes(folder, tracker)
    text = file.read_text() + "    weights: w.bin\n"
    file.write_text(text)
    seen = program.json(
        "simulate", "--model", "soft_bar", "--actions", "actions.csv", "--out", f"own_{tracker}", "--eyes", file, folder=folder
    )
    assert seen["episodes"][0]["sight"]["frames"] > 50
    other = {"ordered": "transporter", "transporter": "ordered"}[tracker]
    file.write_text(text.replace(f"tracker: {tracker}", f"tracker: {other}"))
    done = program("simulate", "--model", "soft_bar", "--actions", "actions.csv", "--out", "no", "--eyes", file, folder=folder)
    assert done.returncode == 2 and "w.bin" in done.stderr and other in done.stderr, done.stderr
    assert not (folder / "no").exists()


def test_the_shipped_trackers_see_the_object_in_pictures(program, folder):
    sights = {}
    for tracker in ("geometric", "ordered", "transporter"):
        arguments = ["--model", "soft_bar", "--actions", "actions.csv", "--out", f"seen_{tracker}", "--eyes", eyes(folder, tracker)]
        sights[tracker] = program.json("simulate", *arguments, folder=folder)["episodes"][0]["sight"]
    assert sights["geometric"]["failures"] == 0.0 and sights["geometric"]["median_error_lengths"] < 0.02
    assert sights["ordered"]["failures"] < 0.1 and sights["ordered"]["median_error_lengths"] < 0.03
    # Transporter's keypoints lie where its training put them.
    assert sights["transporter"]["frames"] == sights["geometric"]["frames"]


def test_a_laboratory_is_drawn_by_its_seed(program, folder):
    bags = {}
    for name, seed in (("plain", []), ("one", ["--laboratory", 5]), ("again", ["--laboratory", 5]), ("other", ["--laboratory", 6])):
        # A bag holds its own name: all have the same one.
        where = ["--out", f"{name}/bag", "--images"]
        program.json("simulate", "--model", "soft_bar", "--actions", "actions.csv", *where, *seed, folder=folder)
        bags[name] = (folder / name / "bag/bag_0.mcap").read_bytes()
    assert bags["one"] == bags["again"]
    assert len({bags["plain"], bags["one"], bags["other"]}) == 3
