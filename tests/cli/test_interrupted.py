"""Ctrl-C ends a long computation within seconds, with the exit code of an interrupt and a line that says what is kept and how to go on."""

import json
import pathlib
import signal
import time

import pytest

from support.program import BAG, MODEL
from support.waiting import wait_for

INTERRUPTED = 130
# Ends of the line on stderr.
LOST = "; kept: nothing; to begin again: the same command\n"
AGAIN = "; to go on: the same command\n"


@pytest.fixture
def interrupt(program, tmp_path):
    """Runs the program and sends it SIGINT `after_s` after it handles the signal; returns exit code, stdout and stderr."""

    def run(*arguments, after_s):
        child = program.start(*arguments, folder=tmp_path, ROS_HOME=str(tmp_path / "ros"))
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
    assert err.startswith("catenary: interrupted after ") and err.endswith(LOST) and err.count("\n") == 1, err
    assert not (tmp_path / "out/posterior.json").exists()


def test_an_interrupted_training_keeps_its_policy_and_goes_on_with_the_same_bits(program, interrupt, tmp_path):
    steps = 40_000
    arguments = ("--model", MODEL, "--steps", steps, "--history", 2, "--no-plan", "--json")
    code, out, err = interrupt("train", "--out", "policy", *arguments, after_s=2)
    assert code == INTERRUPTED
    report = json.loads(out)
    done = report["steps"]
    assert report["interrupted"] is True and 0 < done < steps
    kept = "policy (the policy so far) and policy.state"
    assert err == f"catenary: interrupted after {done} of at most {steps} steps; kept: {kept}; to go on: the same command with --resume\n"
    assert (tmp_path / "policy").stat().st_size > 1000
    other = program("train", "--out", "policy", "--resume", *arguments, "--seed", 2, folder=tmp_path)
    assert other.returncode == 2 and "policy.state: it is of other work" in other.stderr
    rest = program("train", "--out", "policy", "--resume", *arguments, folder=tmp_path, seconds=600)
    assert rest.returncode == 0 and f"resumes after {done} of at most {steps} steps, from policy.state" in rest.stderr, rest.stderr
    assert not (tmp_path / "policy.state").exists()
    whole = program.json("train", "--out", "whole", *arguments[:-1], folder=tmp_path, seconds=600)
    assert (tmp_path / "policy").read_bytes() == (tmp_path / "whole").read_bytes()
    assert json.loads(rest.stdout)["curve"] == whole["curve"]
    again = program("train", "--out", "policy", "--resume", *arguments, folder=tmp_path)
    assert again.returncode == 2 and "--resume: policy.state: expected the state" in again.stderr


def test_an_interrupted_evaluation_keeps_its_episodes_and_gives_the_same_scores(program, interrupt, tmp_path):
    program.text("train", "--model", MODEL, "--out", "policy", "--steps", 512, "--no-plan", folder=tmp_path)
    program.text("train", "--model", MODEL, "--out", "other", "--steps", 512, "--seed", 2, "--no-plan", folder=tmp_path)
    arguments = ("--model", MODEL, "--policy", "policy", "--policy", "other", "--no-plan", "--episodes", 400)
    code, out, err = interrupt("evaluate", *arguments, after_s=1)
    assert (code, out) == (INTERRUPTED, "")
    assert err.startswith("catenary: interrupted after ") and " of 800 episodes; kept: " in err and err.endswith(AGAIN), err
    done = int(err.split()[3])
    (state,) = (tmp_path / "ros/catenary/evaluate").iterdir()
    assert str(state) in err and 0 < done < 800
    home = {"ROS_HOME": str(tmp_path / "ros")}
    rest = program("evaluate", *arguments, "--json", folder=tmp_path, seconds=600, **home)
    assert rest.returncode == 0 and f"resumes after {done} of 800 episodes, from {state}" in rest.stderr
    assert not state.exists()
    assert json.loads(rest.stdout) == program.json("evaluate", *arguments, folder=tmp_path, seconds=600, **home)


def test_an_interrupted_inference_names_the_iterations_that_it_keeps(program, tmp_path):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "out", "--iterations", 50, "--simulations", 150)
    child = program.start("infer", *arguments, folder=tmp_path)
    try:
        wait_for((tmp_path / "out/state.json").exists, 120, "a saved state")
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
    finally:
        child.kill()
        child.wait()
    assert (child.returncode, out) == (INTERRUPTED, "")
    made = len(json.loads((tmp_path / "out/state.json").read_text())["iterations"])
    assert err.endswith(f"; kept: out/state.json ({made} of 50 iterations){AGAIN}"), err
