"""Ctrl-C ends a long computation within seconds; the program says so, and its exit code is that of an interrupted one."""

import json
import os
import pathlib
import signal
import subprocess
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
MODEL = ROOT / "launch_configs/models/soft_bar.yaml"
BAG = ROOT / "bags/swing"
INTERRUPTED = 130


def interrupt(folder, *arguments, after_s):
    """Runs the program, and sends it SIGINT this long after it listens to it; exit code, stdout, stderr."""
    command = [PROGRAM, *map(str, arguments)]
    child = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 30
        while not listens(child.pid):
            assert child.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
        time.sleep(after_s)
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=15)
    finally:
        child.kill()
        child.wait()
    return child.returncode, out, err


def listens(pid):
    """Whether a process has a handler for SIGINT."""
    (caught,) = [row.split()[1] for row in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if row.startswith("SigCgt")]
    return int(caught, 16) >> (signal.SIGINT - 1) & 1


@pytest.mark.parametrize("sizes", [("--simulations", 20000), ("--simulations", 1000, "--preset", "paper")], ids=["simulating", "training"])
def test_an_inference_ends_within_a_round(tmp_path, sizes):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "out", "--iterations", 1, *sizes)
    code, out, err = interrupt(tmp_path, "infer", *arguments, after_s=4)
    assert (code, out) == (INTERRUPTED, "")
    assert err.startswith("catenary: interrupted after ") and err.count("\n") == 1, err
    assert not (tmp_path / "out/posterior.json").exists()


def test_a_training_that_was_interrupted_says_so_and_keeps_the_policy(tmp_path):
    arguments = ("--model", MODEL, "--out", "policy", "--steps", 10_000_000, "--json")
    code, out, err = interrupt(tmp_path, "train", *arguments, after_s=3)
    assert code == INTERRUPTED
    report = json.loads(out)
    assert report["interrupted"] is True and 0 < report["steps"] < 10_000_000
    assert err == f"catenary: interrupted after {report['steps']} of 10000000 steps; policy holds the policy so far\n"
    assert (tmp_path / "policy").stat().st_size > 1000


def test_an_evaluation_ends_within_some_episodes(tmp_path):
    subprocess.run([PROGRAM, "train", "--model", MODEL, "--out", "policy", "--steps", "512"], cwd=tmp_path, check=True, capture_output=True)
    arguments = ("--model", MODEL, "--policy", "policy", "--episodes", 100_000)
    code, out, err = interrupt(tmp_path, "evaluate", *arguments, after_s=2)
    assert (code, out) == (INTERRUPTED, "")
    assert err.startswith("catenary: interrupted after ") and err.endswith(" of 100000 episodes\n"), err
