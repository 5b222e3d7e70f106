"""`catenary infer` on several episodes of one object: one posterior, sharper than that of each."""

import json
import subprocess

import pytest
from conftest import PROGRAM, ROOT

MODEL = ROOT / "launch_configs/models/soft_bar.yaml"
# How much sharper differs from seed to seed; over many, tests beside the code look at it.
SIZES = ["--iterations", "15", "--simulations", "100", "--seed", "2"]


def run(*arguments):
    done = subprocess.run([str(a) for a in (PROGRAM, *arguments)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two episodes of one bar, with different motions and noise."""
    folder = tmp_path_factory.mktemp("pooled")
    written = []
    for number, actions in enumerate(["0.06,0.02", "-0.03,0.05"]):
        motion = folder / f"motion_{number}.csv"
        motion.write_text("dx_m,dz_m\n" + f"{actions}\n0,0\n" * 3)
        bag = folder / f"bag_{number}"
        truth = ("--theta", "length_m=0.25", "--theta", "youngs_modulus_pa=8000")
        run("simulate", "--model", MODEL, "--actions", motion, *truth, "--noise", "--seed", number, "--out", bag)
        written.append(bag)
    return written


def infer(out, *arguments):
    said = json.loads(run("infer", *arguments, "--model", MODEL, "--out", out, "--json", *SIZES))
    return said, {m["name"]: m for m in said["marginals"]}


def test_two_recordings_give_one_sharper_posterior(bags, tmp_path):
    alone = [infer(tmp_path / f"alone_{i}", "--bag", bag) for i, bag in enumerate(bags)]
    said, pooled = infer(tmp_path / "both", "--bag", bags[0], "--bag", bags[1])
    assert said["bags"] == [str(b) for b in bags] and said["episodes"] == 2
    assert said["frames"] == sum(one["frames"] for one, _ in alone)
    assert said["duration_s"] == pytest.approx(sum(one["duration_s"] for one, _ in alone))
    spread = lambda marginals: marginals["length_m"]["sd"] * marginals["youngs_modulus_pa"]["sd"]
    assert spread(pooled) < min(spread(marginals) for _, marginals in alone)
    page = (tmp_path / "both/report.html").read_text()
    assert "2 episodes" in page and bags[1].name in page
