"""A killed `catenary infer` goes on from its last iteration if the same command runs again."""

import json
import time

import pytest

from support.program import BAG, MODEL
from support.waiting import wait_for

# Five iterations: the kill comes after the first. With fewer simulations the made-up recording is said to fit nothing.
SIZES = ["--preset", "networks", "--iterations", "5", "--simulations", "150"]


@pytest.fixture
def start(program):
    """Starts an inference into a folder; returns its process."""
    files = lambda out: ("--bag", BAG, "--model", MODEL, "--out", out)
    return lambda out, *arguments: program.start("infer", *files(out), "--json", *SIZES, *arguments)


def finish(child):
    """Waits for the end of an inference; returns the parts of its answer that do not depend on time, and its stderr."""
    out, err = child.communicate(timeout=120)
    assert child.returncode == 0, err
    said = json.loads(out)
    return {key: said[key] for key in ("posterior", "iterations", "predictive")}, err


def kill_after_an_iteration(child, state):
    """Kills an inference as soon as it has saved its state."""

    def saved():
        assert child.poll() is None, "the inference ended by itself"
        return state.exists()

    wait_for(saved, 60, "a saved state", pause=lambda: time.sleep(0.01))
    child.kill()
    child.communicate()


def test_a_killed_inference_goes_on_and_ends_with_the_same_bits(start, tmp_path):
    whole, err = finish(start(tmp_path / "whole"))
    assert "goes on" not in err and not (tmp_path / "whole/state.json").exists()
    state = tmp_path / "cut/state.json"
    kill_after_an_iteration(start(tmp_path / "cut"), state)
    made = len(json.loads(state.read_text())["iterations"])
    rest, err = finish(start(tmp_path / "cut"))
    assert f"resumes after {made} of 5 iterations" in err
    assert rest == whole and not state.exists()


def test_an_inference_begins_anew_beside_the_state_of_another_or_a_damaged_one(start, tmp_path):
    state = tmp_path / "state.json"
    kill_after_an_iteration(start(tmp_path), state)
    left = state.read_text()
    other, err = finish(start(tmp_path, "--seed", "2"))
    assert "the state of another inference; this one starts over" in err and len(other["iterations"]) == 5
    state.write_text(left[: len(left) // 2])
    _, err = finish(start(tmp_path))
    assert "the inference starts over" in err and "state.json" in err
