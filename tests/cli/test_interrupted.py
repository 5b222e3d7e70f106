"""Ctrl-C ends a long computation within seconds, with a line on stderr and the exit code of an interrupt."""

import json
import pathlib
import signal
import time

import pytest

from support.program import BAG, MODEL
from support.waiting import wait_for

INTERRUPTED = 130


@pytest.fixture
def interrupt(program, tmp_path):
    """Runs the program and sends it SIGINT `after_s` after it handles the signal; returns exit code, stdout and stderr."""

    def run(*arguments, after_s):
        child = program.start(*arguments, folder=tmp_path)
        try:
            wait_for(lambda: handles_sigint(child.pid), 30, "a handler for SIGINT")
            time.sleep(after_s)
            child.send_signal(signal.SIGINT)
            out, err = child.communicate(timeout=15)
        finally:
            child.kill()
            child.wait()
        return child.returncode, out, err

    return run


def handles_sigint(pid):
    """Tells whether a process has a handler for SIGINT."""
    (caught,) = [row.split()[1] for row in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if row.startswith("SigCgt")]
    return int(caught, 16) >> (signal.SIGINT - 1) & 1


@pytest.mark.parametrize("sizes", [("--simulations", 20000), ("--simulations", 1000, "--preset", "paper")], ids=["simulating", "training"])
def test_an_inference_ends_within_a_round(interrupt, tmp_path, sizes):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "out", "--iterations", 1, *sizes)
    # After 4 s the larger number is still being simulated, and of the smaller one the networks of the paper learn.
    code, out, err = interrupt("infer", *arguments, after_s=4)
    assert (code, out) == (INTERRUPTED, "")
    assert err.startswith("catenary: interrupted after ") and err.count("\n") == 1, err
    assert not (tmp_path / "out/posterior.json").exists()


def test_an_interrupted_training_says_so_and_keeps_the_policy(interrupt, tmp_path):
    arguments = ("--model", MODEL, "--out", "policy", "--steps", 10_000_000, "--json")
    code, out, err = interrupt("train", *arguments, after_s=3)
    assert code == INTERRUPTED
    report = json.loads(out)
    assert report["interrupted"] is True and 0 < report["steps"] < 10_000_000
    assert err == f"catenary: interrupted after {report['steps']} of 10000000 steps; policy holds the policy so far\n"
    assert (tmp_path / "policy").stat().st_size > 1000


def test_an_evaluation_ends_within_some_episodes(program, interrupt, tmp_path):
    program.text("train", "--model", MODEL, "--out", "policy", "--steps", 512, folder=tmp_path)
    arguments = ("--model", MODEL, "--policy", "policy", "--episodes", 100_000)
    code, out, err = interrupt("evaluate", *arguments, after_s=2)
    assert (code, out) == (INTERRUPTED, "")
    assert err.startswith("catenary: interrupted after ") and err.endswith(" of 100000 episodes\n"), err
