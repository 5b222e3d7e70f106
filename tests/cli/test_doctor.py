"""`catenary doctor` finds every setting of the machine that keeps nodes apart and says what to do, as text and as JSON."""

import json

import pytest

NAMES = {
    "cores", "loopback", "receive buffer", "send buffer", "disk", "logs", "ffmpeg", "Python", "domain", "other graphs",
    "discovery range", "localhost only", "middleware", "Fast DDS profile",
}  # fmt: skip


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
