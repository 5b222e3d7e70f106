"""Every mistake is answered by one line on stderr that names what is wrong and what was expected, and by an exit code."""

import os
import pathlib
import socket
import subprocess

import domains
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
MODEL = ROOT / "launch_configs/models/soft_bar.yaml"
LAUNCH = ROOT / "launch_configs/sim.launch.xml"
BAG = ROOT / "bags/swing"
CLAIM = domains.Domain()
DOMAIN = CLAIM.number
USAGE = 2


def run(folder, *arguments, **environment):
    """Runs the program in a folder to its end."""
    assert PROGRAM.exists(), f"{PROGRAM} is missing: cargo build --release"
    own = {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=os.environ | own | environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
    )


def refused(folder, *arguments, says, code=None, speaker="catenary", **environment):
    """Asserts that the program answers with one line that holds every part of `says`, and nothing on stdout."""
    done = run(folder, *arguments, **environment)
    assert done.returncode == code if code else done.returncode not in (0, None)
    assert done.returncode > 0, f"ended by signal {-done.returncode}"
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"{speaker}: "), done.stderr
    for part in says:
        assert str(part) in lines[0], done.stderr


NO_FILE = "No such file"
NO_BAG = ("nowhere", "expected a bag folder or an .mcap or .db3 file")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("infer", "--bag", "nowhere", "--model", MODEL, "--out", "out"), NO_BAG),
        (("infer", "--bag", BAG, "--model", "nowhere.yaml", "--out", "out"), ("model nowhere.yaml", NO_FILE)),
        (("infer", "--bag", BAG, "--model", MODEL, "--out", "out", "--policy", "nowhere"), ("policy nowhere", NO_FILE)),
        (("train", "--model", "nowhere.yaml", "--out", "p"), ("model nowhere.yaml", NO_FILE)),
        (("train", "--model", MODEL, "--posterior", "nowhere.json", "--out", "p"), ("posterior nowhere.json", NO_FILE)),
        (("deploy", "--policy", "nowhere"), ("policy nowhere", NO_FILE)),
        (("import-track", "nowhere.csv", "--model", MODEL, "--out", "bag"), ("track nowhere.csv", NO_FILE)),
        (("replay", "nowhere"), NO_BAG),
        (("report", "--dir", "nowhere"), ("nowhere/summary.json", NO_FILE)),
        (("launch", "nowhere.xml"), ("launch file nowhere.xml", NO_FILE)),
        (("doctor", "--model", "nowhere.yaml"), ("model nowhere.yaml", NO_FILE)),
        (("record", "--out", BAG), (BAG, "expected a folder that does not exist yet")),
        (("train", "--model", MODEL, "--preset", "sb3", "--out", BAG), (BAG, "cannot be written")),
        (("infer", "--bag", BAG, "--model", MODEL, "--preset", "paper", "--out", MODEL), (MODEL,)),
    ],
    ids=lambda value: value[0] if isinstance(value[0], str) else None,
)
def test_a_wrong_path_is_named(tmp_path, arguments, says):
    refused(tmp_path, *arguments, says=says, code=1)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("inffer",), ("inffer", "infer")),
        (("infer", "--bag", BAG), ("--model", "--out")),
        (("infer", "--bag", BAG, "--model", MODEL, "--out", "x", "--episode", "last"), ("last", "--episode")),
        (("train", "--model", MODEL, "--out", "x", "--stesp", 3), ("--stesp", "--steps")),
        (("node", "camra"), ("camra", "camera")),
        (("infer", "--bag", BAG, "--model", MODEL, "--out", "x", "--episode", -1), ("-1", "--episode", "1..")),
        (("bench", "inference", "--seeds", 0), ("0", "--seeds", "1..")),
    ],
    ids=["command", "missing", "value", "option", "node", "negative", "no seeds"],
)
def test_a_wrong_command_line_is_named(tmp_path, arguments, says):
    refused(tmp_path, *arguments, says=says, code=USAGE)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("train", "--model", MODEL, "--out", "p", "--preset", "big"), ("preset", "default or sb3", "big")),
        (("launch", LAUNCH, "sed:=1"), (LAUNCH, "sed", "seed")),
        (("launch", LAUNCH, "seed"), ("NAME:=VALUE", "seed")),
        (("infer", "--bag", BAG, "--model", MODEL, "--out", "x", "--episode", 99), ("swing", "99")),
        (("infer", "--bag", BAG, "--bag", BAG, "--model", MODEL, "--out", "x"), ("each episode once", "swing twice")),
        (
            ("infer", "--bag", BAG, "--bag", BAG, "--model", MODEL, "--out", "x", *("--episode", 1) * 3),
            ("one for each bag", "3 episodes of 2 bags"),
        ),
        (("record", "--out", "bag", "--regex", "(a"), ("regex", "(a", "unclosed group")),
        (("record", "--out", "bag", "--max-bag-size", 1000), ("max_bag_size", "at least 1024", "1000")),
        (("record", "--out", "bag", "--qos-profile-overrides-path", MODEL), ("QoS overrides", MODEL)),
        (("replay", BAG, "--topics", "/dlo/keypoint"), ("/dlo/keypoint", "/dlo/keypoints")),
        (("replay", BAG, "--clock", 0), ("clock", "0.1 to 10000 Hz", "0.0")),
        (("replay", BAG, "--exclude-regex", "*"), ("exclude_regex", "repetition operator")),
        (("record", "--out", "bag", "--topics", ""), ("topics", "/dlo/keypoints")),
        (("record", "--out", MODEL / "bag"), (MODEL, "cannot make the folder", "not a directory")),
        (("infer", "--bag", BAG, "--model", MODEL, "--out", "x", "--simulations", 99999999999999), ("simulations", "at most 6666")),
        (("infer", "--bag", BAG, "--model", MODEL, "--out", "x", "--iterations", 2000000000), ("iterations", "at most 1000")),
        (("replay", BAG, "--rate", 0), ("rate", "0.001 to 1000000")),
        (("replay", BAG, "--rate", "1e-300"), ("rate", "0.001 to 1000000", "1e-300")),
        (("replay", BAG, "--start-offset-s", "1e9"), ("start_offset_s", "s of the bag")),
        (("launch", LAUNCH, "bin:=/nope"), ("bin:=/nope", "/nope/simulated_cell")),
        (("launch", MODEL), (MODEL, "launch file", "is this one")),
        (("deploy", "--policy", MODEL), (MODEL, "is this a policy?")),
    ],
)
def test_a_wrong_value_is_named_with_those_that_are_right(tmp_path, arguments, says):
    refused(tmp_path, *arguments, says=says, code=1)


def test_an_evaluation_without_sense_is_refused_before_it_begins(tmp_path):
    run(tmp_path, "train", "--model", MODEL, "--out", "policy", "--steps", 512)
    text = MODEL.read_text()
    (tmp_path / "quick.yaml").write_text(text.replace("step_period_s: 0.5", "step_period_s: 0.2"))
    (tmp_path / "idle.yaml").write_text(text[: text.index("task:")])
    wanted = ("evaluate", "--policy", "policy", "--model")
    refused(tmp_path, *wanted, "quick.yaml", says=("policy: ", "step_period_s", "0.5", "0.2"))
    (tmp_path / "long.yaml").write_text(text.replace("  steps: 16", "  steps: 20"))
    refused(tmp_path, *wanted, "long.yaml", says=("policy: ", "`steps` is 16, the task has 20"))
    refused(tmp_path, *wanted, "idle.yaml", says=("has no task",))
    refused(tmp_path, *wanted, MODEL, "--theta", "lenght_m=0.2", says=("--theta lenght_m", "length_m, youngs_modulus_pa"))
    refused(tmp_path, *wanted, MODEL, "--effect", "length_m=0.2", says=("it is inferred: expected --theta length_m=0.2",))
    refused(tmp_path, *wanted, MODEL, "--effect", "wind=1", says=("`wind`: unknown", "linear_drag_n_s_m2"))
    refused(tmp_path, *wanted, MODEL, "--fidelity", "best", says=("--fidelity", "fast, fine_mesh, standard or reference", "best"))
    refused(tmp_path, *wanted, MODEL, "--episodes", 5, says=("--episodes", "30"))


def test_a_deployment_that_waits_for_nothing_is_refused_before_it_begins(tmp_path):
    run(tmp_path, "train", "--model", MODEL, "--out", "policy", "--steps", 512)
    refused(tmp_path, "deploy", "--policy", "policy", "--wait-s", 0, says=("--wait-s", "positive"), code=1)


TRACK = "t_s,grip_x_m,grip_z_m,grip_pitch_rad,p1_x_m,p1_z_m,p2_x_m,p2_z_m,p3_x_m,p3_z_m,p4_x_m,p4_z_m\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", ("track.csv", "an empty file")),
        (TRACK + "".join(f"{0.05 * i},400,420,0,400,400,400,350,400,300,400,250\n" for i in range(40)), ("in m", "all 160 outside")),
    ],
    ids=["empty", "millimetres"],
)
def test_a_track_without_sense_becomes_no_bag(tmp_path, text, says):
    (tmp_path / "track.csv").write_text(text)
    refused(tmp_path, "import-track", "track.csv", "--model", MODEL, "--out", "bag", says=says, code=1)
    assert not (tmp_path / "bag").exists()


def cut(folder, share):
    """A file with the first part of the sample bag's bytes."""
    whole = (BAG / "swing_0.mcap").read_bytes()
    path = folder / "cut.mcap"
    path.write_bytes(whole[: int(share * len(whole))])
    return path


@pytest.mark.parametrize(
    ("share", "says"),
    [(0.0, ("an empty file",)), (0.0001, ("begins neither as an MCAP file nor as a database of sqlite3",)), (0.3, ("no complete episode", "0 episode ends"))],
)
def test_a_truncated_bag_is_named_with_what_is_left_of_it(tmp_path, share, says):
    path = cut(tmp_path, share)
    refused(tmp_path, "infer", "--bag", path, "--model", MODEL, "--out", "x", says=(path, *says), code=1)


def test_a_truncated_bag_is_read_up_to_its_last_complete_chunk(tmp_path):
    sizes = ("--iterations", 1, "--simulations", 40)
    done = run(tmp_path, "infer", "--bag", cut(tmp_path, 0.9), "--model", MODEL, "--out", "x", *sizes)
    assert done.returncode == 0, done.stderr


def test_a_missing_topic_is_named_with_those_that_are_there(tmp_path):
    path = tmp_path / "poses"
    with Reader(BAG) as reader, Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        (source,) = [c for c in reader.connections if c.topic == "/panda/current_pose"]
        connection = writer.add_connection(source.topic, source.msgtype, typestore=get_typestore(Stores.ROS2_JAZZY))
        for _, time, data in reader.messages([source]):
            writer.write(connection, time, data)
    says = (path, "/dlo/keypoints", "/episode/event")
    refused(tmp_path, "infer", "--bag", path, "--model", MODEL, "--out", "x", says=says, code=1)


@pytest.mark.parametrize(
    ("field", "wrong", "says"),
    [
        ("version: 1", "version: 7", ("`version`", "1, the version that this program reads", "7")),
        ("density_kg_m3: 1055.0", "density_kg_m3: .nan", ("`parameters.density_kg_m3`", "a finite number", "NaN")),
        ("low: 0.195", "low: .nan", ("`theta.length_m.prior`", "NaN", "finite")),
        ("low: 0.195, high: 0.305", "low: 0.305, high: 0.195", ("`theta.length_m.prior`", "low < high", "low 0.305")),
        ("{name: length_m, prior: {uniform: {low: 0.195, high: 0.305}}}", "{name: length_m}", ("`theta.length_m`", "prior")),
        ("name: table_friction", "name: length_m", ("`effects.1`", "once", "length_m")),
        ("side_m: 0.015", "side_m: -.inf", ("`object.section.square.side_m`", "positive", "-inf")),
        ("time_constant_s: 0.16", "time_constant_s: .nan", ("`arm.law.lag.time_constant_s`", "NaN")),
        ("step_period_s: 0.5", "step_period_s: 0", ("`task.step_period_s`", "0")),
        ("axial_law: neo_hookean", "axial_law: hooke", ("`object.axial_law`", "hooke", "linear, neo_hookean")),
        ("rate_hz: 60.0", "rate_hz: fast", ("`camera.rate_hz`", "a number", "`fast`")),
        ("keypoint_noise_px:", "keypoint_nose_px:", ("keypoint_nose_px", "keypoint_noise_px")),
        ("density_kg_m3:", "densty_kg_m3:", ("`parameters.densty_kg_m3`", "densty_kg_m3", "density_kg_m3")),
        ("  rate_hz: 60.0", "\trate_hz: 60.0", ("spaces", "a tab")),
    ],
)
def test_a_wrong_value_in_a_model_file_is_named(tmp_path, field, wrong, says):
    text = MODEL.read_text()
    assert text.count(field) == 1
    line = f"line {1 + text[: text.index(field)].count(chr(10))}"
    path = tmp_path / "model.yaml"
    path.write_text(text.replace(field, wrong))
    refused(tmp_path, "infer", "--bag", BAG, "--model", path, "--out", "x", says=(path, line, *says), code=1)


@pytest.mark.parametrize(
    "arguments",
    [
        ("infer", "--bag", BAG, "--out", "x"),
        ("train", "--out", "p"),
        ("import-track", "track.csv", "--out", "bag"),
        ("simulate", "--actions", "actions.csv"),
        ("bench", "pool"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_every_command_reads_the_same_model_file(tmp_path, arguments):
    path = tmp_path / "model.yaml"
    path.write_text(MODEL.read_text().replace("density_kg_m3:", "densty_kg_m3:"))
    says = (f"model {path}: line 11, `parameters.densty_kg_m3`: expected a parameter that the simulator has",)
    refused(tmp_path, *arguments, "--model", path, says=says, code=1)


@pytest.mark.parametrize("node", ["simulated_cell", "policy_runner", "panda_bridge"])
def test_every_node_reads_the_same_model_file(tmp_path, node):
    path = tmp_path / "model.yaml"
    path.write_text(MODEL.read_text().replace("steps: 16", "steps: 0"))
    says = (f"model_file {path}: line 43, `task.steps`: expected at least 1, got 0",)
    refused(tmp_path, "node", node, "--ros-args", "-p", f"model_file:={path}", says=says, code=2, speaker=node)


@pytest.mark.parametrize(
    ("field", "wrong", "says"),
    [
        ("density_kg_m3: 1055.0", "density_kg_m3: -5", ("density_kg_m3", "-5")),
        ("density_kg_m3:", "densty_kg_m3:", ("densty_kg_m3", "density_kg_m3")),
        ("name: length_m", "name: lenght_m", ("lenght_m", "length_m")),
    ],
)
def test_a_check_up_finds_what_an_inference_would_refuse(tmp_path, field, wrong, says):
    text = MODEL.read_text()
    assert text.count(field) == 1
    (tmp_path / "model.yaml").write_text(text.replace(field, wrong))
    done = run(tmp_path, "doctor", "--model", "model.yaml")
    assert done.returncode == 1
    (row,) = [line for line in done.stdout.splitlines() if " model " in line]
    assert row.startswith("BAD") and all(part in row for part in says), row


@pytest.mark.parametrize(
    ("arguments", "says", "code"),
    [
        (("-p", "max_age_s:=.nan"), ("max_age_s:=.nan", "finite"), USAGE),
        (("-p", "max_age_s:=-1.0"), ("max_age_s", "0.001 to 10 s", "-1"), USAGE),
        (("-p", "max_age_s:=soon"), ("max_age_s", "a number", "soon"), USAGE),
        (("-p", "max_age:=1.0"), ("max_age", "max_age_s", "patience_s"), USAGE),
        (("-p", "max_age_s"), ("max_age_s", "NAME:=VALUE"), USAGE),
        (("--params-file", "nowhere.yaml"), ("nowhere.yaml", NO_FILE), USAGE),
        (("--parms-file", "x"), ("--parms-file", "--params-file"), USAGE),
        (("-p", "model_file:=nowhere.yaml"), ("model_file nowhere.yaml", NO_FILE), USAGE),
        (("--log-level", "loud"), ("loud", "debug, info, warn"), USAGE),
    ],
    ids=lambda value: value[1] if isinstance(value, tuple) else None,
)
def test_a_wrong_parameter_of_a_node_is_named(tmp_path, arguments, says, code):
    refused(tmp_path, "node", "policy_runner", "--ros-args", *arguments, says=says, code=code, speaker="policy_runner")


@pytest.mark.parametrize(
    ("theta", "says"), [("[0.25]", ("theta", "2 values", "1")), ("[90.0, 1000.0]", ("length_m", "90"))], ids=["too few", "too long"]
)
def test_a_cell_without_sense_is_not_worth_starting_again(tmp_path, theta, says):
    arguments = ("--ros-args", "-p", f"model_file:={MODEL}", "-p", f"theta:={theta}")
    refused(tmp_path, "node", "simulated_cell", *arguments, says=says, code=USAGE, speaker="simulated_cell")


@pytest.mark.parametrize("command", ["record", "demo", "launch", "node"])
@pytest.mark.parametrize(
    ("variable", "value"), [("ROS_DOMAIN_ID", "999"), ("ROS_DOMAIN_ID", "lab"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")]
)
def test_a_wrong_environment_is_named(tmp_path, command, variable, value):
    arguments = {"record": ("--out", "bag"), "demo": ("--out", "demo"), "launch": (LAUNCH,), "node": ("camera",)}[command]
    speaker = "camera" if command == "node" else "catenary"
    refused(tmp_path, command, *arguments, says=(variable, value, "expected"), speaker=speaker, **{variable: value})
    assert not list(tmp_path.iterdir()), "something was written all the same"


def test_a_domain_without_a_free_port_is_named(tmp_path):
    # RTPS 2.5, section 9.6.2.3: the discovery port of participant p in domain d is 7400 + 250 d + 10 + 2 p.
    sockets = []
    try:
        for participant in range(120):
            sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            try:
                sockets[-1].bind(("0.0.0.0", 7400 + 250 * DOMAIN + 10 + 2 * participant))
            except OSError:
                pass  # somebody has it already, which is what is wanted
        says = (f"domain {DOMAIN}", "expected a free UDP port", "ROS_DOMAIN_ID")
        refused(tmp_path, "node", "camera", says=says, code=1, speaker="camera")
        refused(tmp_path, "record", "--out", "bag", says=says, code=1)
    finally:
        for used in sockets:
            used.close()
