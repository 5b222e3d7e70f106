"""A full disk ends a command with exit code 1, file and reason; an older result stays whole, and nothing else is left.

The disk is a limit on the size of files, which needs no right of root: a write beyond it fails as on a full disk, with another reason.
"""

import resource
import signal
import subprocess

import pytest

from support.program import BAG, MODEL, PROGRAM

FAILED = 1
SIMULATION = ("--model", MODEL, "--actions", MODEL.with_name("gallery.csv"), "--fidelity", "fast")


def limited(size):
    """Limits files of the process to `size` bytes. SIGXFSZ, which would end it, is ignored, so that a write fails."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    return limit


@pytest.mark.parametrize(
    ("result", "size", "arguments"),
    [
        ("policy", 4096, ("train", "--model", MODEL, "--steps", 512, "--no-plan", "--out", "policy")),
        ("out/posterior.json", 300, ("infer", BAG, "--model", MODEL, "--iterations", 1, "--simulations", 40, "--out", "out")),
        ("picture.png", 4096, ("simulate", *SIMULATION, "--picture", "picture.png")),
        ("film.gif", 4096, ("simulate", *SIMULATION, "--video", "film.gif")),
        ("report.html", 4096, ("train", "--model", MODEL, "--steps", 512, "--no-plan", "--out", "/dev/null", "--report", "report.html")),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_failed_write_keeps_the_old_result_and_leaves_nothing_else(program, tmp_path, result, size, arguments):
    old = tmp_path / result
    old.parent.mkdir(exist_ok=True)
    old.write_text("old")
    command = [PROGRAM, *map(str, arguments)]
    done = subprocess.run(
        command, cwd=tmp_path, env=program.environment(), capture_output=True, text=True, timeout=120, check=False, preexec_fn=limited(size)
    )
    assert done.returncode == FAILED, done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("catenary: ") and result in last and "File too large" in last, done.stderr
    assert old.read_text() == "old"
    assert not [path.name for path in old.parent.iterdir() if "draft" in path.name or path.name.startswith(".")]


def test_stdout_that_takes_nothing_is_a_failure(program, tmp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [PROGRAM, "effects"], cwd=tmp_path, env=program.environment(), stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == FAILED and "No space left on device" in done.stderr, done.stderr
