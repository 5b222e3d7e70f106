"""catenary-inspect on a bag that `catenary simulate` makes, and on what is no bag."""

import json
import math
import os
import pathlib
import subprocess

import numpy
import pytest
from catenary_inspect.main import main
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
MODEL = ROOT / "launch_configs/models/dlo_0.yaml"
ACTIONS = ((0.05, -0.05), (0.04, -0.06), (0.0, 0.03), (-0.06, 0.06))
NOISE_PX = 0.8


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    (folder / "actions.csv").write_text("dx_m,dz_m\n" + "".join(f"{dx},{dz}\n" for dx, dz in ACTIONS))
    command = [PROGRAM, "simulate", "--model", MODEL, "--actions", "actions.csv", "--noise", "--out", "bag", "--fidelity", "fast"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=60)
    return folder / "bag"


@pytest.fixture
def figures(capsys):
    """What a command prints as JSON."""

    def run(*arguments):
        assert main([*map(str, arguments), "--json"]) == 0, capsys.readouterr().err
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture
def refused(capsys):
    """Runs a command that has to end with one line that holds all of `says`."""

    def run(*arguments, says):
        assert main(list(map(str, arguments))) == 1
        said = capsys.readouterr()
        assert said.out == "" and said.err.startswith("catenary-inspect: ") and said.err.count("\n") == 1
        for part in says:
            assert part in said.err, said.err

    return run


def is_picture(path):
    """A PNG with more than one colour in it."""
    from matplotlib.image import imread

    pixels = imread(path)
    return min(pixels.shape[:2]) > 300 and pixels[..., :3].std() > 0.02


def test_an_episode_is_told_step_by_step(bag, figures):
    said = figures("episode", "--bag", bag)
    (episode,) = said["episodes"]
    assert (episode["policy"], episode["actions"], episode["end"], episode["duration_s"]) == ("actions", len(ACTIONS), "complete", 2.0)
    for row, (dx, dz) in zip(said["steps"], ACTIONS, strict=True):
        assert (row["dx_mm"], row["dz_mm"]) == pytest.approx((1e3 * dx, 1e3 * dz))
        # The arm lags, and is nearly there at the end of a step.
        assert math.hypot(row["target_x_m"] - row["reached_x_m"], row["target_z_m"] - row["reached_z_m"]) < 0.01
    targets = [row["target_x_m"] for row in said["steps"]]
    assert numpy.diff([0.40, *targets]) == pytest.approx([dx for dx, _ in ACTIONS])


def test_keypoints_have_the_rate_and_the_noise_of_the_model(bag, figures):
    said = figures("keypoints", "--bag", bag)
    assert said["frames"] == 121 and said["rate_hz"] == pytest.approx(60, rel=1e-3) and said["order_flips"] == 0
    assert said["longest_gap_s"] == pytest.approx(1 / 60, rel=1e-3)
    for point in said["points"][:4]:
        assert point["seen"] == 1 and point["noise_u_px"] == pytest.approx(NOISE_PX, rel=0.35)


def test_latencies_of_a_simulated_bag_are_none_and_its_periods_even(bag, figures):
    said = figures("latency", "--bag", bag)
    rows = {row["topic"]: row for row in said["topics"]}
    assert rows["/panda/current_pose"]["rate_hz"] == pytest.approx(200) and rows["/dlo/keypoints"]["rate_hz"] == pytest.approx(60, rel=1e-3)
    assert all(row["age"]["max_ms"] == 0 for row in rows.values())
    assert rows["/panda/current_pose"]["period"] == pytest.approx({"p50_ms": 5, "p99_ms": 5, "max_ms": 5}, rel=1e-3)


def test_what_came_late_is_seen(bag, figures, tmp_path):
    """The same bag, logged 30 ms later, and every tenth keypoint 200 ms later."""
    with Reader(bag) as reader, Writer(tmp_path / "late", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        of = {}
        for c in reader.connections:
            known = {"msgdef": c.msgdef.data, "rihs01": c.digest, "offered_qos_profiles": c.ext.offered_qos_profiles}
            of[c.id] = writer.add_connection(c.topic, c.msgtype, **known)
        for number, (connection, time_ns, data) in enumerate(reader.messages()):
            late = connection.topic == "/dlo/keypoints" and number % 10 == 0
            writer.write(of[connection.id], time_ns + (200 if late else 30) * 10**6, data)
    rows = {row["topic"]: row["age"] for row in figures("latency", "--bag", tmp_path / "late")["topics"]}
    assert rows["/panda/current_pose"] == pytest.approx({"p50_ms": 30, "p99_ms": 30, "max_ms": 30})
    assert rows["/dlo/keypoints"]["p50_ms"] == pytest.approx(30) and rows["/dlo/keypoints"]["max_ms"] == pytest.approx(200)


def test_topics_of_a_bag_are_listed_with_rate_and_profile(bag, figures):
    rows = {row["name"]: row for row in figures("graph", "--bag", bag)["topics"]}
    assert rows["/panda/current_pose"]["count"] == 401 and rows["/panda/current_pose"]["rate_hz"] == pytest.approx(200)
    assert rows["/episode/event"]["profile"] == "reliable, transient local"
    assert not any(row["problems"] for row in rows.values())


@pytest.mark.parametrize("command", ["graph", "episode", "keypoints", "latency"])
def test_there_is_a_table_and_a_picture(bag, tmp_path, capsys, command):
    picture = tmp_path / "made/picture.png"
    assert main([command, "--bag", str(bag), "--out", str(picture)]) == 0
    said = capsys.readouterr()
    assert len(said.out.splitlines()) >= 4 and str(picture) in said.err
    assert is_picture(picture)


SHIPPED = ("uniform: {low: 0.195, high: 0.305}", "log_uniform: {low: 1.0e+3, high: 5.0e+4}")
HALVES = "[{weight: 3, prior: {log_uniform: {low: 2.0e+3, high: 2.0e+4}}}, {weight: 1, prior: {uniform: {low: 1.0e+4, high: 5.0e+4}}}]"
OTHERS = ("normal: {mean: 0.26, sd: 0.02, low: 0.2, high: 0.3}", f"mixture: {HALVES}")


@pytest.mark.parametrize("priors", [SHIPPED, OTHERS], ids=["uniform", "gaussian and mixture"])
def test_the_posterior_of_a_file_is_that_of_the_report(bag, figures, tmp_path, priors):
    text = (ROOT / "launch_configs/models/soft_bar.yaml").read_text()
    for shipped, other in zip(SHIPPED, priors):
        assert shipped in text
        text = text.replace(shipped, other)
    model = tmp_path / "model.yaml"
    model.write_text(text)
    sizes = ["--iterations", "1", "--simulations", "60", "--out", tmp_path / "out", "--json"]
    command = [PROGRAM, "infer", "--bag", bag, "--model", model, *sizes]
    done = subprocess.run(command, capture_output=True, timeout=60)
    # A posterior of 60 simulations is rough, and may fit nothing of the recording: 3.
    assert done.returncode in (0, 3), done.stderr
    theirs = {m["name"]: m for m in json.loads(done.stdout)["marginals"]}
    said = figures("posterior", "--file", tmp_path / "out/posterior.json", "--out", tmp_path / "posterior.png")
    assert is_picture(tmp_path / "posterior.png")
    for mine in said["marginals"]:
        low, high = mine["q05"], mine["q95"]
        their = theirs[mine["name"]]
        assert low < mine["median"] < high and mine["low"] <= low and high <= mine["high"]
        assert mine["median"] == pytest.approx(their["median"], rel=0.05), (mine, their)
        assert mine["mean"] == pytest.approx(their["mean"], rel=0.05), (mine, their)


def test_mistakes_are_named(bag, refused, tmp_path):
    refused("episode", "--bag", tmp_path / "nowhere", says=("nowhere", "expected a bag folder", "nothing there"))
    (tmp_path / "text.txt").write_text("no bag")
    refused("episode", "--bag", tmp_path / "text.txt", says=("text.txt", ".mcap", "another file"))
    (tmp_path / "bad.mcap").write_text("no bag")
    refused("episode", "--bag", tmp_path / "bad.mcap", says=("bad.mcap", "MCAP"))
    refused("graph", "--bag", tmp_path / "bad.mcap", says=("bad.mcap", "MCAP"))
    refused("episode", "--bag", bag, "--episode", 7, says=("--episode 7", "which has 1"))
    refused("posterior", "--bag", bag, says=(str(bag), "/bayes_sim/posterior", "catenary_msgs/msg/Mixture", "found /dlo/keypoints (121), "))
    refused("posterior", "--bag", next(bag.glob("*.mcap")), says=("/bayes_sim/posterior", "found /dlo/keypoints (121), "))
    refused("posterior", "--file", bag / "metadata.yaml", says=("metadata.yaml", "posterior.json"))
    refused("keypoints", "--bag", bag, "--seconds", 0, says=("--seconds", "above 0", "got 0"))


def test_a_picture_of_another_kind_is_refused(bag, tmp_path, capsys):
    assert main(["keypoints", "--bag", str(bag), "--out", str(tmp_path / "picture.bmp")]) == 1
    assert ".png, .pdf or .svg" in capsys.readouterr().err and not list(tmp_path.iterdir())
