"""`catenary infer` that is killed goes on where it was, when it is asked again."""

import json
import signal
import subprocess
import time

from conftest import PROGRAM, ROOT

SIZES = ["--iterations", "5", "--simulations", "150"]


def start(out, *arguments):
    files = ["--bag", ROOT / "bags/swing", "--model", ROOT / "launch_configs/models/soft_bar.yaml", "--out", out]
    command = [str(a) for a in (PROGRAM, "infer", *files, "--json", *SIZES, *arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(child):
    out, err = child.communicate(timeout=120)
    assert child.returncode == 0, err
    said = json.loads(out)
    return {key: said[key] for key in ("posterior", "iterations", "predictive")}, err


def test_a_killed_inference_goes_on_and_ends_with_the_same_bits(tmp_path):
    whole, err = finish(start(tmp_path / "whole"))
    assert "goes on" not in err and not (tmp_path / "whole/state.json").exists()
    cut, state = start(tmp_path / "cut"), tmp_path / "cut/state.json"
    deadline = time.monotonic() + 60
    while not state.exists():
        assert cut.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    cut.send_signal(signal.SIGKILL)
    cut.communicate()
    made = len(json.loads(state.read_text())["iterations"])
    rest, err = finish(start(tmp_path / "cut"))
    assert f"goes on after {made} of 5 iterations" in err
    assert rest == whole and not state.exists()


def test_a_state_of_another_inference_or_of_half_a_file_is_not_gone_on_from(tmp_path):
    cut, state = start(tmp_path), tmp_path / "state.json"
    while not state.exists():
        assert cut.poll() is None
        time.sleep(0.01)
    cut.send_signal(signal.SIGKILL)
    cut.communicate()
    left = state.read_text()
    other, err = finish(start(tmp_path, "--seed", "2"))
    assert "of another inference; begun anew" in err and len(other["iterations"]) == 5
    state.write_text(left[: len(left) // 2])
    _, err = finish(start(tmp_path))
    assert "begun anew" in err and "state.json" in err
