"""`catenary doctor` finds every setting of the machine that keeps nodes apart and says what to do, as text and as JSON."""

import json
import os
import signal
import subprocess

import pytest

from support.program import PROGRAM

NAMES = {
    "cores", "loopback", "receive buffer", "default buffer", "send buffer", "disk", "logs", "ffmpeg", "Python", "kernel", "rtprio",
    "memlock", "CPU governor", "robot network", "domain", "other graphs", "discovery range", "ros2 daemon", "localhost only",
    "middleware", "Fast DDS profile",
}  # fmt: skip
# Checks that matter to a real arm alone.
REAL_TIME = ("kernel", "rtprio", "memlock", "CPU governor")


# Variables of the environment that change what nodes hear; None leaves them out.
UNSET = dict.fromkeys(("RMW_IMPLEMENTATION", "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_LOCALHOST_ONLY"))


@pytest.fixture
def doctor(program, tmp_path):
    """Runs `catenary doctor` in an environment without the variables in UNSET; returns the CompletedProcess."""
    return lambda *arguments, **environment: program("doctor", *arguments, folder=tmp_path, seconds=60, **(UNSET | environment))


def test_every_check_has_a_verdict_and_a_remedy_where_it_is_not_good(doctor):
    found = {check["name"]: check for check in json.loads(doctor("--json", "--model", "soft_bar").stdout)}
    assert set(found) == NAMES | {"model"}
    for check in found.values():
        assert check["verdict"] in ("good", "warning", "bad") and check["detail"]
        assert ("remedy" in check) == (check["verdict"] != "good"), check
    assert found["model"]["verdict"] == "good"


def test_needs_of_a_real_arm_are_warnings_where_a_robot_is_named(doctor):
    # TEST-NET-1 of RFC 5737: no machine has this address, and no robot is straight beside this one.
    runs = {robot: doctor("--json", *(["--robot", robot] if robot else [])) for robot in (None, "127.0.0.1", "192.0.2.7")}
    found = {robot: {check["name"]: check for check in json.loads(done.stdout)} for robot, done in runs.items()}
    for name in REAL_TIME:
        named, unnamed = found["127.0.0.1"][name], found[None][name]
        assert unnamed["verdict"] == "good", unnamed
        assert ("see --robot" in unnamed["detail"]) == (named["verdict"] == "warning"), (named, unnamed)
    # A kernel says itself whether it is a real-time one.
    is_realtime = any(words in os.uname().version for words in ("PREEMPT_RT", "PREEMPT RT"))
    assert (found["127.0.0.1"]["kernel"]["verdict"] == "good") == is_realtime
    network = {robot: checks["robot network"] for robot, checks in found.items()}
    assert "--robot" in network[None]["detail"] and "this machine" in network["127.0.0.1"]["detail"]
    # Its way leads by some interface, or there is none.
    far = network["192.0.2.7"]
    assert far["detail"].startswith("there is no route" if far["verdict"] == "bad" else "by "), far
    assert runs["192.0.2.7"].returncode == (1 if far["verdict"] == "bad" else 0)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give up the rights of root")
def test_a_refused_priority_and_a_limit_of_locked_memory_are_named(program, tmp_path):
    without = ["setpriv", "--bounding-set=-sys_nice,-ipc_lock", "--inh-caps=-sys_nice,-ipc_lock"]
    command = ["prlimit", "--rtprio=0", "--memlock=8388608", *without, PROGRAM, "doctor", "--json", "--robot", "127.0.0.1"]
    environment = program.environment(**UNSET)
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60, check=True)
    found = {check["name"]: check for check in json.loads(done.stdout)}
    for name, says in (("rtprio", "refused"), ("memlock", "8192 KiB")):
        check = found[name]
        assert check["verdict"] == "warning" and says in check["detail"] and "limits.conf" in check["remedy"], check


def test_lines_of_a_check_up_fit_80_columns(doctor):
    done = doctor()
    rows = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    assert len(rows) == len(NAMES) and all(row.startswith(("ok ", "warning", "BAD")) for row in rows)
    # Lines with a path may be longer, because a path cannot be broken.
    assert all(len(line) <= 80 or "/" in line for line in done.stdout.splitlines()), done.stdout


# A variable of the environment, its value, the name of the check that it changes, and a part of the detail.
SETTINGS = [
    ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp", "middleware", "Zenoh"),
    ("RMW_IMPLEMENTATION", "rmw_cyclonedds", "middleware", "did you mean `rmw_cyclonedds_cpp`?"),
    ("ROS_LOCALHOST_ONLY", "1", "localhost only", "deprecated"),
    ("FASTRTPS_DEFAULT_PROFILES_FILE", "nowhere.xml", "Fast DDS profile", "no such file"),
    ("FASTDDS_DEFAULT_PROFILES_FILE", "nowhere.xml", "Fast DDS profile", "no such file"),
    ("PATH", "/nowhere", "ffmpeg", "not on the PATH"),
    ("ROS_LOG_DIR", "/dev/null/logs", "logs", "nothing can be written"),
]


@pytest.fixture(scope="module")
def reports(program, tmp_path_factory):
    """Checks by name for each setting. The runs are started together, because most of their time is waiting for other nodes."""
    folder = tmp_path_factory.mktemp("settings")
    start = lambda variable, value: program.start("doctor", "--json", folder=folder, **(UNSET | {variable: value}))
    runs = {(variable, value): start(variable, value) for variable, value, _, _ in SETTINGS}
    found = {setting: json.loads(child.communicate(timeout=60)[0]) for setting, child in runs.items()}
    return {setting: {check["name"]: check for check in checks} for setting, checks in found.items()}


@pytest.mark.parametrize(("variable", "value", "name", "says"), SETTINGS)
def test_a_setting_that_limits_the_graph_gives_a_warning(reports, variable, value, name, says):
    check = reports[variable, value][name]
    assert check["verdict"] == "warning" and says in check["detail"] and check["remedy"], check


def test_nodes_of_another_graph_are_named(program, doctor):
    other = program.start("node", "camera", "--ros-args", "-r", "__ns:=/lab")
    try:
        # The check listens for a limited time; a busy machine may need a second run until the node is discovered.
        for _ in range(3):
            (check,) = [c for c in json.loads(doctor("--json").stdout) if c["name"] == "other graphs"]
            if check["verdict"] != "good":
                break
        assert check["verdict"] == "warning" and "/lab/camera" in check["detail"], check
    finally:
        other.terminate()
        other.communicate(timeout=10)
    assert "doctor" not in json.dumps(check), "it does not find itself"


def test_a_daemon_of_ros2_that_hears_another_range_is_named(doctor):
    """A process with the arguments with which `ros2` starts its daemon stands for one."""
    command = ["sh", "-c", "sleep 60 & wait", "--name", "ros2-daemon", "--ros-domain-id", "57", "--rmw-implementation", "rmw_fastrtps_cpp"]
    environment = {"PATH": os.environ["PATH"], "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    daemon = subprocess.Popen(command, env=environment, start_new_session=True)

    def found(**settings):
        checks = json.loads(doctor("--json", ROS_DOMAIN_ID="57", **settings).stdout)
        return next(check for check in checks if check["name"] == "ros2 daemon")

    try:
        other = found(ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET")
        assert other["verdict"] == "warning" and other["remedy"].startswith("ros2 daemon stop")
        assert f"process {daemon.pid} hears LOCALHOST, and nodes here SUBNET" in other["detail"]
        assert found(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")["verdict"] == "good"
    finally:
        os.killpg(daemon.pid, signal.SIGKILL)
        daemon.wait()
    assert found(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")["detail"] == "none runs for this domain"
