"""The bridge's transport `fci` drives a robot that others wrote: franka-sim, a Franka Research 3 on MuJoCo (FCI version 10)."""

import os
import signal
import subprocess
import sys
import time

import pytest
from rig import HERE, ROOT, TARGET, without_real_time

PYTHON = ROOT / ".venv/franka_sim/bin/python"
FOLLOW = TARGET / "examples/follow"
ADDRESS = f"127.63.{os.getpid() % 250}.1"
CYCLES = 3000


@pytest.fixture
def robot(tmp_path):
    """Starts franka-sim; returns the path of its log."""
    if not PYTHON.exists():
        pytest.skip(f"{PYTHON} is missing: tests/environment makes it")
    log = tmp_path / "franka_sim.log"
    command = [*without_real_time(), PYTHON, HERE / "franka_sim/serve.py", ADDRESS]
    environment = os.environ | {"FR3_MJCF": str(HERE / "franka_sim/fr3.xml")}
    with log.open("wb") as file:
        process = subprocess.Popen(list(map(str, command)), stdout=file, stderr=file, env=environment)
    until = time.monotonic() + 60
    while "listening" not in log.read_text().lower():
        assert process.poll() is None and time.monotonic() < until, log.read_text()
        time.sleep(0.2)
    yield log
    process.send_signal(signal.SIGINT)
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()


def test_the_bridge_holds_the_arm_of_franka_sim(robot):
    done = subprocess.run([FOLLOW, ADDRESS, str(CYCLES), "fr3"], capture_output=True, text=True, timeout=120, check=False)
    told = robot.read_text()
    assert done.returncode == 0, f"{done.stderr}\n{told}"
    cycles = int(done.stdout.split()[0])
    assert cycles >= CYCLES and "violation" not in told.lower(), f"{done.stdout}\n{told}"
    print(f"franka-sim 1.1.7: cycles, computing p50, p99, greatest (us), lost states: {done.stdout.strip()}", file=sys.stderr)
