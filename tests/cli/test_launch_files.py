"""`catenary launch` reads launch files as ROS 2's own launch does.

Tests compare with ROS 2's launch if it is installed, and always with the meaning that its documentation gives.
"""

import importlib.util
import json
import os
import pathlib
import shutil
import subprocess
from xml.sax.saxutils import quoteattr

import pytest
import yaml

from support.given_parameters import of_rclpy
from support.program import ROOT

FILES = sorted((ROOT / "launch_configs").glob("*.launch.xml"))
MISSING = [name for name in ("launch", "launch_xml", "launch_ros") if importlib.util.find_spec(name) is None]
beside_ros2 = pytest.mark.skipif(bool(MISSING), reason=f"ROS 2's own launch is not installed: no {', '.join(MISSING)}")

ARGUMENTS = {
    "sim.launch.xml": [
        {},
        {"learning": "false", "seed": "7"},
        {"lock_step": "true", "real_time_factor": "1000.0"},
        {"cell_theta": "[0.25, 1000.0]", "respawn": "False", "bin": "/x y/z"},
    ],
    "emulated.launch.xml": [{}, {"learning": "false", "address": "127.3.2.1", "network": "lab"}],
    "lab.launch.xml": [
        {},
        {"transport": "fci", "robot": "172.16.0.2"},
        {"record": "true", "bag": "a b", "image": "/c/i"},
        {"controller": "/arm", "record": "1", "images": "true"},
    ],
    "replay.launch.xml": [{}, {"vision": "false"}, {"learning": "0", "respawn": "false"}],
    "train.launch.xml": [{}, {"workers": "3", "namespace": "/lab", "memory_limit_mib": "9000"}, {"inference": "false", "respawn": "no"}],
    "find_effects.launch.xml": [{}],
}

SAMPLE = """
<launch>
  <arg name="rate" default="$(env NO_SUCH_VARIABLE 60)" description="frames a second"/>
  <arg name="side" default="left"><choice value="left"/><choice value="right"/></arg>
  <arg name="both" default="false"/>
  <let name="here" value="$(dirname)"/><let name="file" value="$(filename)"/><let name="text" value="a 'b' &quot;c&quot;"/>
  <executable cmd="run $(var text) 'd e' f$(var rate)g $(var here)/x $(var file) \\$(var rate) $x" name="first" output="screen"/>
  <executable cmd="$(find-exec sh) -c 'exit 0'" cwd="/tmp" respawn="$(var both)" respawn_delay="0.5" respawn_max_retries="4"/>
  <executable
    cmd="$(if $(var both) one two) $(not $(var both)) $(and true $(var both)) $(or 1 0) $(equals 1 1.0) $(not-equals a 'b c')"/>
  <executable cmd="never" unless="$(equals $(var side) left)"/>
  <set_env name="SAMPLE_A" value="1"/>
  <group>
    <set_env name="SAMPLE_A" value="2"/><append_env name="SAMPLE_A" value="3" separator=";"/>
    <append_env name="SAMPLE_A" value="0" prepend="true"/>
    <let name="rate" value="10"/><unset_env name="HOME"/>
    <executable cmd="inside $(var rate) $(env SAMPLE_A)" sigterm_timeout="1.5"><env name="SAMPLE_B" value="$(env SAMPLE_A)!"/></executable>
  </group>
  <group scoped="false" if="$(var both)"><let name="rate" value="11"/></group>
  <executable cmd="outside $(var rate) $(env SAMPLE_A)"/>
  <include file="$(var here)/inner.launch.xml"><arg name="who" value="you $(var rate)"/></include>
  <executable cmd="after $(var who) $(var default) $(var leak)" launch-prefix="nice -n 5"/>
  <push_ros_namespace namespace="lab"/>
  <node pkg="sample" exec="tracker" name="eyes" namespace="$(var side)"
        args="--fast $(var text)" ros_args="--log-level debug" exec_name="t">
    <param name="width" value="640"/><param name="rate" value="$(var rate)" type="float"/><param name="word" value="7" type="str"/>
    <param from="$(var here)/p.yaml"/>
    <param name="dlo"><param name="hue" value="[190.0, 250.0]"/><param name="names" value="[a, b]"/></param><param name="on" value="true"/>
    <remap from="image" to="/camera/$(var side)"/><remap from="~/x" to="y"/><env name="SAMPLE_C" value="c"/>
  </node>
  <node pkg="sample" exec="tracker" namespace="/absolute" respawn="true"/>
  <group><push-ros-namespace namespace="deeper"/><node pkg="sample" exec="tracker" name="n"><param name="a" value="text"/></node></group>
  <executable cmd="$(find-pkg-share sample)/x $(find-pkg-prefix sample) $(exec-in-pkg tracker sample)"/>
</launch>
"""
INNER = """<launch><arg name="who"/><arg name="default" default="d"/><arg name="rate" default="1"/><let name="leak" value="$(var rate)"/>
  <executable cmd="inner $(var who) $(var default) $(dirname)"/></launch>"""


@pytest.fixture
def sample(tmp_path, monkeypatch):
    """Path of a launch file with every element, beside the file that it includes and a package that it names."""
    (tmp_path / "sample.launch.xml").write_text(SAMPLE)
    (tmp_path / "inner.launch.xml").write_text(INNER)
    (tmp_path / "p.yaml").write_text("/**: {ros__parameters: {x: 1}}")
    index = tmp_path / "prefix/share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "sample").touch()
    executable = tmp_path / "prefix/lib/sample/tracker"
    executable.parent.mkdir(parents=True)
    executable.write_text("#!/bin/sh\n")
    executable.chmod(0o755)
    (tmp_path / "prefix/share/sample").mkdir()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/prefix:{os.environ.get('AMENT_PREFIX_PATH', '')}")
    return tmp_path / "sample.launch.xml"


@pytest.fixture
def show(program):
    """Runs `catenary launch --show` on a file; returns the CompletedProcess."""
    words = lambda arguments: [f"{name}:={value}" for name, value in arguments.items()]
    # The domain of the environment itself, because ROS 2's launch reads that one.
    domain = os.environ.get("ROS_DOMAIN_ID")
    return lambda path, arguments: program("launch", path, "--show", "--json", *words(arguments), ROS_DOMAIN_ID=domain)


@pytest.fixture
def processes(show):
    """Processes that `catenary launch` would start, with the parameter files that it would write read as YAML."""

    def of_file(path, arguments):
        done = show(path, arguments)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)["processes"]
        for process in found:
            process["command"] = [yaml.safe_load(word) if "ros__parameters" in word else word for word in process["command"]]
        return found

    return of_file


@pytest.fixture
def assert_same(processes):
    """Asserts that ROS 2's launch and `catenary launch` would start the same processes."""

    def compare(path, arguments):
        from support import ros2_launch

        theirs = ros2_launch.processes(path, arguments)
        ours = processes(path, arguments)
        assert len(theirs) == len(ours) > 0
        for expected, got in zip(theirs, ours):
            # ROS 2 numbers all processes, `catenary launch` only processes of one name.
            got["name"] = expected["name"] if got["name"].rsplit("-", 1)[0] == expected["name"] else got["name"]
            here = {name: value for name, value in got["environment"].items() if os.environ.get(name) != value}
            assert got | {"environment": here} == expected

    return compare


@beside_ros2
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_ros_2_reads_the_shipped_files_in_the_same_way(assert_same, path):
    for arguments in ARGUMENTS[path.name]:
        assert_same(path, arguments)


@beside_ros2
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_ros_2_finds_the_nodes_of_a_checkout_without_an_installation(path, monkeypatch):
    from support import ros2_launch

    monkeypatch.delenv("CATENARY_BIN", raising=False)
    for process in ros2_launch.processes(path, ARGUMENTS[path.name][0]):
        program = process["command"][0]
        assert os.access(program, os.X_OK), program
    # One of the node scripts in launch_configs/bin, which call the program.
    done = subprocess.run([program, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and f"Usage: {pathlib.Path(program).name}" in done.stdout, done.stderr


def test_a_checkout_that_is_not_built_says_what_to_build(tmp_path):
    shutil.copytree(ROOT / "launch_configs/bin", tmp_path / "launch_configs/bin", symlinks=True)
    environment = {name: value for name, value in os.environ.items() if name != "CARGO_TARGET_DIR"}
    done = subprocess.run([tmp_path / "launch_configs/bin/camera"], capture_output=True, text=True, env=environment, check=False)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith(f"camera: {tmp_path}/target/release/catenary is missing")
    assert "cargo build --release" in line and "CATENARY_BIN" in line


@beside_ros2
@pytest.mark.parametrize("arguments", [{}, {"both": "true"}, {"side": "right", "rate": "5"}], ids=str)
def test_ros_2_reads_every_element_in_the_same_way(assert_same, sample, arguments):
    assert_same(sample, arguments)


def test_every_element_has_the_meaning_that_ros_2_documents(processes, sample):
    folder, prefix = sample.parent, f"{sample.parent}/prefix"
    found = processes(sample, {"both": "true", "side": "right"})
    commands = [process["command"] for process in found]
    text = "a 'b' \"c\""
    assert commands[0] == ["run", text, "d e", "f60g", f"{folder}/x", str(sample), "$(var", "rate)", "$x"]
    assert commands[1][1:] == ["-c", "exit 0"] and commands[1][0].endswith("/sh")
    assert commands[2] == ["one", "false", "true", "true", "true", "true"]
    assert commands[3:] == [
        ["never"],
        ["inside", "10", "0:2;3"],
        ["outside", "11", "1"],
        ["inner", "you 11", "d", str(folder)],
        ["nice", "-n", "5", "after", "you 11", "d", "11"],
        [f"{prefix}/lib/sample/tracker", "--fast", text, "--ros-args", "--log-level", "debug"]
        + ["--ros-args", "-r", "__node:=eyes", "-r", "__ns:=/lab/right"]
        + ["--params-file", {"/lab/right/eyes": {"ros__parameters": {"width": 640}}}]
        + ["--params-file", {"/lab/right/eyes": {"ros__parameters": {"rate": 11.0}}}]
        + ["--params-file", {"/lab/right/eyes": {"ros__parameters": {"word": "7"}}}, "--params-file", f"{folder}/p.yaml"]
        + ["--params-file", {"/lab/right/eyes": {"ros__parameters": {"dlo.hue": [190.0, 250.0], "dlo.names": ["a", "b"]}}}]
        + ["--params-file", {"/lab/right/eyes": {"ros__parameters": {"on": True}}}, "-r", "image:=/camera/right", "-r", "~/x:=y"],
        [f"{prefix}/lib/sample/tracker", "--ros-args", "-r", "__ns:=/absolute"],
        [f"{prefix}/lib/sample/tracker", "--ros-args", "-r", "__node:=n", "-r", "__ns:=/lab/deeper"]
        + ["--params-file", {"/lab/deeper/n": {"ros__parameters": {"a": "text"}}}],
        [f"{prefix}/share/sample/x", prefix, f"{prefix}/lib/sample/tracker"],
    ]
    by_name = {process["name"]: process for process in found}
    assert (by_name["sh"]["respawn"], by_name["sh"]["respawn_delay_s"], by_name["sh"]["respawn_max_retries"]) == (True, 0.5, 4)
    assert by_name["sh"]["directory"] == "/tmp" and by_name["first"]["respawn"] is False
    assert by_name["inside"]["environment"] == {"HOME": None, "SAMPLE_A": "0:2;3", "SAMPLE_B": "0:2;3!"}
    assert by_name["inside"]["sigterm_timeout_s"] == 1.5 and by_name["outside"]["sigterm_timeout_s"] == 5.0
    assert by_name["outside"]["environment"] == {"SAMPLE_A": "1"} and by_name["t"]["environment"]["SAMPLE_C"] == "c"
    assert by_name["tracker"]["respawn"] is True and by_name["tracker"]["respawn_max_retries"] is None


def test_unsupported_elements_are_refused_by_name(show, sample):
    for inside, said in [
        ('<timer period="1.0"/>', ("line 2, <timer>", "expected arg, let, group, include, executable, node")),
        ('<executable cmd="x" shell="true"/>', ("line 2, <executable>", "unknown attribute `shell`; it takes cmd, name")),
        ('<group forwarding="false"/>', ("line 2, <group>", "unknown attribute `forwarding`")),
        ('<node pkg="sample" exec="tracker"><param from="x" allow_substs="true"/></node>', ("line 2, <param>", "from")),
        ('<executable cmd="$(eval 1)"/>', ("line 2, <executable>", "cmd: `$(eval 1)`: expected one of var NAME")),
        ('<include file="$(dirname)/inner.launch.xml"><arg name="who" value="$(filename)"/></include>', ("line 2, <include>", "<let>")),
    ]:
        sample.write_text(f"<launch>\n{inside}</launch>")
        done = show(sample, {})
        assert done.returncode == 2 and done.stdout == "", inside
        assert all(words in done.stderr for words in (*said, str(sample))), done.stderr


def test_every_argument_of_a_shipped_file_is_described(show):
    assert {path.name for path in FILES} >= {"sim.launch.xml", "lab.launch.xml", "replay.launch.xml", "train.launch.xml"}
    for path in FILES:
        done = show(path, {})
        assert done.returncode == 0, done.stderr
        arguments = json.loads(done.stdout)["arguments"]
        assert all(len(argument["description"]) > 10 and argument["default"] is not None for argument in arguments), path.name


READER = ROOT / "nodes/catenary/src/launch/reader"
# Rows of a value, its type, its separator, and the parameter of a ROS 2 node.
VALUES = [(value, kind, None, expected) for value, kind, expected in json.loads((READER / "values.json").read_text())]
VALUES += [tuple(row) for row in json.loads((READER / "separated_values.json").read_text())]
VARIABLES = {"five": "5", "list": "[1, 2]", "word": "1e3", "bad": "''*''", "b": "true"}


def with_params(path, params):
    """Writes a launch file with one node that has these parameters, each a name, a value, a type or None, a separator or None."""
    lets = "".join(f"<let name={quoteattr(name)} value={quoteattr(value)}/>" for name, value in VARIABLES.items())
    names = ("name", "value", "type", "value-sep")
    texts = [" ".join(f"{name}={quoteattr(text)}" for name, text in zip(names, param) if text is not None) for param in params]
    rows = "".join(f"<param {text}/>" for text in texts)
    path.write_text(f'<launch>{lets}<node exec="/x" name="cam" namespace="/">{rows}</node></launch>')
    return path


def of_node(texts, folder):
    """Parameters that a node of rclpy reads from files with these texts, by name; None if it refuses them."""
    arguments = []
    for i, text in enumerate(texts):
        (folder / f"{i}.yaml").write_text(text)
        arguments += ["--params-file", str(folder / f"{i}.yaml")]
    return of_rclpy(arguments)


def parameter_texts(found):
    """Texts of the parameter files of processes."""
    return [word for process in found for word in process["command"] if "ros__parameters" in word]


def test_a_node_gets_the_values_that_ros_2s_launch_would_bring(show, tmp_path):
    accepted = [(f"p{i}", *row) for i, row in enumerate(VALUES) if row[-1]]
    done = show(with_params(tmp_path / "x.launch.xml", [row[:-1] for row in accepted]), {})
    assert done.returncode == 0, done.stderr
    got = of_node(parameter_texts(json.loads(done.stdout)["processes"]), tmp_path)
    assert got == {row[0]: row[-1] for row in accepted}


@beside_ros2
def test_the_table_of_values_holds_for_ros_2s_launch(tmp_path):
    from support import ros2_launch

    wrong = []
    for value, kind, separator, expected in VALUES:
        path = with_params(tmp_path / "x.launch.xml", [("a", value, kind, separator)])
        try:
            texts = parameter_texts(ros2_launch.processes(path, {}, read=lambda file: file.read()))
        except Exception:
            texts = None
        got = texts and of_node(texts, tmp_path)
        if (got and got["a"]) != expected:
            wrong.append((value, kind, separator, expected, got))
    assert not wrong


def test_a_value_that_has_no_type_is_refused_with_its_place(show, tmp_path):
    for value, kind, said in [
        ("[1, 2.5]", None, "all of one type"),
        ("[1e3, x]", None, "a node reads the string"),
        ("2001-01-01", None, "a date"),
        ("null", None, "nothing"),
        ("{a: 1}", None, "a map"),
        ("0x1F", "int", "expected int"),
        ("$(var bad)", None, "expected YAML"),
        ("$(var list)", "list_of_int", "expected list_of_int"),
    ]:
        done = show(with_params(tmp_path / "x.launch.xml", [("some", value, kind, None)]), {})
        assert done.returncode == 2 and done.stdout == "", value
        assert all(words in done.stderr for words in ("line 1", "<param>", "some", f"`{value}`", said)), done.stderr
