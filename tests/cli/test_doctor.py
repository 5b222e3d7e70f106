"""What a check-up of the machine finds: each setting that parts nodes, with what to do, as text and as JSON."""

import json
import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
NAMES = {
    "cores", "loopback", "receive buffer", "send buffer", "disk", "logs", "ffmpeg", "Python", "domain", "other graphs",
    "discovery range", "localhost only", "middleware", "Fast DDS profile",
}  # fmt: skip


def run(folder, *arguments, **environment):
    own = {"ROS_DOMAIN_ID": str(60 + os.getpid() % 36), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    names = ("RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_LOCALHOST_ONLY")
    kept = {name: value for name, value in os.environ.items() if name not in names}
    command = [PROGRAM, "doctor", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, env=kept | own | environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)


def test_everything_that_may_keep_nodes_apart_is_looked_at_with_what_to_do(tmp_path):
    found = {check["name"]: check for check in json.loads(run(tmp_path, "--json", "--model", "soft_bar").stdout)}
    assert set(found) == NAMES | {"model"}
    for check in found.values():
        assert check["verdict"] in ("good", "warning", "bad") and check["detail"]
        assert ("remedy" in check) == (check["verdict"] != "good"), check
    assert found["model"]["verdict"] == "good"


def test_lines_of_a_check_up_fit_80_columns(tmp_path):
    done = run(tmp_path)
    rows = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    assert len(rows) == len(NAMES) and all(row.startswith(("ok ", "warning", "BAD")) for row in rows)
    # A path alone may be longer than a line.
    assert all(len(line) <= 80 or "/" in line for line in done.stdout.splitlines()), done.stdout


@pytest.mark.parametrize(
    ("variable", "value", "name", "says"),
    [
        ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp", "middleware", "Zenoh"),
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds", "middleware", "did you mean `rmw_cyclonedds_cpp`?"),
        ("ROS_LOCALHOST_ONLY", "1", "localhost only", "deprecated"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "nowhere.xml", "Fast DDS profile", "no such file"),
        ("FASTDDS_DEFAULT_PROFILES_FILE", "nowhere.xml", "Fast DDS profile", "no such file"),
        ("PATH", "/nowhere", "ffmpeg", "not on the PATH"),
        ("ROS_LOG_DIR", "/dev/null/logs", "logs", "nothing can be written"),
    ],
)
def test_a_setting_that_limits_the_graph_is_warned_of(tmp_path, variable, value, name, says):
    (check,) = [c for c in json.loads(run(tmp_path, "--json", **{variable: value}).stdout) if c["name"] == name]
    assert check["verdict"] == "warning" and says in check["detail"] and check["remedy"], check


def test_nodes_of_another_graph_are_named(tmp_path):
    environment = os.environ | {"ROS_DOMAIN_ID": str(60 + os.getpid() % 36), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    other = subprocess.Popen([PROGRAM, "node", "camera", "--ros-args", "-r", "__ns:=/lab"], env=environment, stderr=subprocess.DEVNULL)
    try:
        for _ in range(3):
            (check,) = [c for c in json.loads(run(tmp_path, "--json").stdout) if c["name"] == "other graphs"]
            if check["verdict"] != "good":
                break
        assert check["verdict"] == "warning" and "/lab/camera" in check["detail"], check
    finally:
        other.terminate()
        other.wait(10)
    assert "doctor" not in json.dumps(check), "it does not find itself"
