"""Every mistake of a user gets one line on stderr that names the fault and the expected value, and an exit code above 0."""

import contextlib
import socket
import subprocess

import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from support.program import BAG, MODEL, PROGRAM, ROOT

LAUNCH = ROOT / "launch_configs/sim.launch.xml"
# Exit code of a wrong command line, and of a wrong file that it names.
USAGE = 2
# Words about topics without their option, and about an option that takes the bag.
TOPICS = ("topics follow --topics", "the bag's folder -o")
TAKEN = ("takes the words after it", "give BAG before it, or as --bag BAG")


@pytest.fixture
def refused(program, tmp_path):
    """Runs the program, which has to answer with one line that holds every part of `says`, and with nothing on stdout."""

    def run(*arguments, says, code=None, speaker="catenary", **environment):
        done = program(*arguments, folder=tmp_path, seconds=60, **environment)
        assert done.returncode == code if code else done.returncode not in (0, None)
        assert done.returncode > 0, f"ended by signal {-done.returncode}"
        assert done.stdout == ""
        lines = done.stderr.splitlines()
        assert len(lines) == 1 and lines[0].startswith(f"{speaker}: "), done.stderr
        for part in says:
            assert str(part) in lines[0], done.stderr

    return run


NO_FILE = "No such file"
FIDELITIES = "fast, fine_mesh, standard, reference"
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
def test_a_wrong_path_is_named(refused, arguments, says):
    refused(*arguments, says=says, code=USAGE)


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
        (("train", "--model", MODEL, "--out", "p", "--preset", "big"), ("--preset", "default, sb3", "big")),
        (("simulate", "--model", MODEL, "--actions", "x", "--fidelity", "fine-mesh"), ("--fidelity", FIDELITIES)),
        (("record", "-o", "x", "/a", "/b"), ("/b", *TOPICS)),
        (("record", "-o", "x", "/a"), TOPICS),
        (("record", "/nowhere/keypoints"), ("/nowhere/keypoints", "a topic's name", *TOPICS)),
        (("record", "--topics", "/a", "/b", "x"), ("--topics", *TAKEN)),
        (("replay", "--topics", "/dlo/keypoints", BAG), ("--topics", *TAKEN)),
        (("replay", "--rate", 2, "-m", "/a:=/b", BAG), ("-m", *TAKEN)),
    ],
    ids=[
        "command",
        "missing",
        "value",
        "option",
        "node",
        "negative",
        "no seeds",
        "preset",
        "fidelity",
        "topics without option",
        "topic and bag",
        "topic as bag",
        "bag as topic to record",
        "bag as topic",
        "bag as name",
    ],
)
def test_a_wrong_command_line_is_named(refused, arguments, says):
    refused(*arguments, says=says, code=USAGE)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
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
        (("infer", BAG, "--model", MODEL, "--out", "x", "--iterations", 1, "--prior-support", "adaptive"), ("one iteration",)),
        (("replay", BAG, "--rate", 0), ("rate", "0.001 to 1000000")),
        (("replay", BAG, "--rate", "1e-300"), ("rate", "0.001 to 1000000", "1e-300")),
        (("replay", BAG, "--start-offset-s", "1e9"), ("start_offset_s", "s of the bag")),
        (("launch", LAUNCH, "bin:=/nope"), ("bin:=/nope", "/nope/simulated_cell")),
        (("launch", MODEL), (MODEL, "launch file", "no valid XML")),
        (("deploy", "--policy", MODEL), (MODEL, "is this a policy?")),
    ],
)
def test_a_wrong_value_is_named_with_the_right_ones(refused, arguments, says):
    refused(*arguments, says=says, code=USAGE)


def test_an_impossible_evaluation_is_refused_before_it_begins(program, refused, tmp_path):
    program("train", "--model", MODEL, "--out", "policy", "--steps", 512, "--no-plan", folder=tmp_path)
    text = MODEL.read_text()
    (tmp_path / "quick.yaml").write_text(text.replace("step_period_s: 0.5", "step_period_s: 0.2"))
    (tmp_path / "idle.yaml").write_text(text[: text.index("task:")])
    wanted = ("evaluate", "--policy", "policy", "--model")
    refused(*wanted, "quick.yaml", says=("policy: ", "step_period_s", "0.5", "0.2"))
    (tmp_path / "long.yaml").write_text(text.replace("  steps: 16", "  steps: 20"))
    refused(*wanted, "long.yaml", says=("policy: ", "`steps` is 16, the task has 20"))
    refused(*wanted, "idle.yaml", says=("has no task",))
    refused(*wanted, MODEL, "--theta", "lenght_m=0.2", says=("--theta lenght_m", "length_m, youngs_modulus_pa"))
    refused(*wanted, MODEL, "--effect", "length_m=0.2", says=("it is inferred: expected --theta length_m=0.2",))
    refused(*wanted, MODEL, "--effect", "wind=1", says=("`wind`: unknown", "linear_drag_n_s_m2"))
    refused(*wanted, MODEL, "--fidelity", "best", says=("--fidelity", FIDELITIES, "best"))
    refused(*wanted, MODEL, "--episodes", 5, says=("--episodes", "30"))


def test_a_deployment_with_no_time_to_wait_is_refused_before_it_begins(program, refused, tmp_path):
    program("train", "--model", MODEL, "--out", "policy", "--steps", 512, "--no-plan", folder=tmp_path)
    refused("deploy", "--policy", "policy", "--wait-s", 0, says=("--wait-s", "positive"), code=USAGE)


TRACK = "t_s,grip_x_m,grip_z_m,grip_pitch_rad,p1_x_m,p1_z_m,p2_x_m,p2_z_m,p3_x_m,p3_z_m,p4_x_m,p4_z_m\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", ("track.csv", "an empty file")),
        (TRACK + "".join(f"{0.05 * i},400,420,0,400,400,400,350,400,300,400,250\n" for i in range(40)), ("in m", "all 160 outside")),
    ],
    ids=["empty", "millimetres"],
)
def test_an_empty_track_and_one_in_millimetres_become_no_bag(refused, tmp_path, text, says):
    (tmp_path / "track.csv").write_text(text)
    refused("import-track", "track.csv", "--model", MODEL, "--out", "bag", says=says, code=USAGE)
    assert not (tmp_path / "bag").exists()


def cut(folder, share):
    """File with the first part of the sample bag's bytes."""
    whole = (BAG / "swing_0.mcap").read_bytes()
    path = folder / "cut.mcap"
    path.write_bytes(whole[: int(share * len(whole))])
    return path


@pytest.mark.parametrize(
    ("share", "says"),
    [
        (0.0, ("an empty file",)),
        (0.0001, ("begins neither as an MCAP file nor as a database of sqlite3",)),
        (0.3, ("no complete episode", "0 episode ends")),
    ],
)
def test_a_truncated_bag_is_named_with_its_remaining_content(refused, tmp_path, share, says):
    path = cut(tmp_path, share)
    refused("infer", "--bag", path, "--model", MODEL, "--out", "x", says=(path, *says), code=USAGE)


def test_a_truncated_bag_is_read_up_to_its_last_complete_chunk(program, tmp_path):
    sizes = ("--preset", "networks", "--iterations", 1, "--simulations", 40)
    done = program("infer", "--bag", cut(tmp_path, 0.9), "--model", MODEL, "--out", "x", *sizes, folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_missing_topic_is_named_with_the_present_ones(refused, tmp_path):
    path = tmp_path / "poses"
    with Reader(BAG) as reader, Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        (source,) = [c for c in reader.connections if c.topic == "/panda/current_pose"]
        connection = writer.add_connection(source.topic, source.msgtype, typestore=get_typestore(Stores.ROS2_JAZZY))
        for _, time, data in reader.messages([source]):
            writer.write(connection, time, data)
    says = (path, "/dlo/keypoints", "/episode/event")
    refused("infer", "--bag", path, "--model", MODEL, "--out", "x", says=says, code=USAGE)


@pytest.mark.parametrize(
    ("field", "wrong", "says"),
    [
        ("version: 1", "version: 7", ("`version`", "1, the version that this program reads", "7")),
        ("density_kg_m3: 1055.0", "density_kg_m3: .nan", ("`parameters.density_kg_m3`", "a finite number", "NaN")),
        ("low: 0.195", "low: .nan", ("`theta.length_m.prior`", "NaN", "finite")),
        ("low: 0.195, high: 0.305", "low: 0.305, high: 0.195", ("`theta.length_m.prior`", "low < high", "low 0.305")),
        ("{name: length_m, prior: {uniform: {low: 0.195, high: 0.305}}}", "{name: length_m}", ("`theta.length_m`", "prior")),
        ("name: table_friction", "name: length_m", ("`effects.1`", "once", "length_m")),
        ("side_m: 0.015", "side_m: -.inf", ("`object.section.square.side_m`", "0.00001 to 0.1 m", "-inf")),
        ("time_constant_s: 0.16", "time_constant_s: .nan", ("`arm.law.lag.time_constant_s`", "NaN")),
        ("step_period_s: 0.5", "step_period_s: 0", ("`task.step_period_s`", "0")),
        ("axial_law: neo_hookean", "axial_law: hooke", ("`object.axial_law`", "hooke", "linear, neo_hookean")),
        ("rate_hz: 60.0", "rate_hz: fast", ("`camera.rate_hz`", "a number", "`fast`")),
        ("keypoint_noise_px:", "keypoint_nose_px:", ("keypoint_nose_px", "keypoint_noise_px")),
        ("density_kg_m3:", "densty_kg_m3:", ("`parameters.densty_kg_m3`", "densty_kg_m3", "density_kg_m3")),
        ("  rate_hz: 60.0", "\trate_hz: 60.0", ("spaces", "a tab")),
    ],
)
def test_a_wrong_value_in_a_model_file_is_named(refused, tmp_path, field, wrong, says):
    text = MODEL.read_text()
    assert text.count(field) == 1
    line = f"line {1 + text[: text.index(field)].count(chr(10))}"
    path = tmp_path / "model.yaml"
    path.write_text(text.replace(field, wrong))
    refused("infer", "--bag", BAG, "--model", path, "--out", "x", says=(path, line, *says), code=USAGE)


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
def test_every_command_reads_the_same_model_file(refused, tmp_path, arguments):
    path = tmp_path / "model.yaml"
    path.write_text(MODEL.read_text().replace("density_kg_m3:", "densty_kg_m3:"))
    says = (f"model {path}: line 11, `parameters.densty_kg_m3`: expected a parameter that the simulator has",)
    refused(*arguments, "--model", path, says=says, code=USAGE)


@pytest.mark.parametrize("node", ["simulated_cell", "policy_runner", "panda_bridge"])
def test_every_node_reads_the_same_model_file(refused, tmp_path, node):
    path = tmp_path / "model.yaml"
    path.write_text(MODEL.read_text().replace("steps: 16", "steps: 0"))
    says = (f"model_file {path}: line 43, `task.steps`: expected at least 1, got 0",)
    refused("node", node, "--ros-args", "-p", f"model_file:={path}", says=says, code=2, speaker=node)


@pytest.mark.parametrize(
    ("field", "wrong", "says"),
    [
        ("density_kg_m3: 1055.0", "density_kg_m3: -5", ("density_kg_m3", "-5")),
        ("density_kg_m3:", "densty_kg_m3:", ("densty_kg_m3", "density_kg_m3")),
        ("name: length_m", "name: lenght_m", ("lenght_m", "length_m")),
    ],
)
def test_a_check_up_finds_what_an_inference_would_refuse(program, tmp_path, field, wrong, says):
    text = MODEL.read_text()
    assert text.count(field) == 1
    (tmp_path / "model.yaml").write_text(text.replace(field, wrong))
    done = program("doctor", "--model", "model.yaml", folder=tmp_path)
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
def test_a_wrong_parameter_of_a_node_is_named(refused, arguments, says, code):
    refused("node", "policy_runner", "--ros-args", *arguments, says=says, code=code, speaker="policy_runner")


@pytest.mark.parametrize(
    ("theta", "says"), [("[0.25]", ("theta", "2 values", "1")), ("[90.0, 1000.0]", ("length_m", "90"))], ids=["too few", "too long"]
)
def test_a_cell_with_an_impossible_object_ends_with_the_code_for_wrong_arguments(refused, theta, says):
    arguments = ("--ros-args", "-p", f"model_file:={MODEL}", "-p", f"theta:={theta}")
    refused("node", "simulated_cell", *arguments, says=says, code=USAGE, speaker="simulated_cell")


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("infer", BAG, "--model", "softbar", "--out", "x"), "soft_bar"),
        (("infer", BAG, "--model", MODEL.with_name("soft_bra.yaml"), "--out", "x"), MODEL),
        (("info", BAG.with_name("swimg")), BAG),
        (("replay", BAG.parent / "swing/swing_1.mcap"), BAG / "swing_0.mcap"),
        (("launch", LAUNCH.with_name("sim.lanch.xml")), LAUNCH),
        (("launch", LAUNCH, "sed:=1"), "seed"),
        (("effects", "--name", "tip_mas_kg"), "tip_mass_kg"),
        (("effects", "--name", "mass"), "tip_mass_kg"),
        (("node", "camra"), "camera"),
        (("simulate", "--model", "soft_bar", "--actions", "actions.csv", "--theta", "lenght_m=0.2"), "length_m"),
        (("simulate", "--model", "soft_bar", "--actions", "actions.csv", "--effect", "linear_drag=1"), "linear_drag_n_s_m2"),
        (("simulate", "--model", "soft_bar", "--actions", "action.csv"), "actions.csv"),
        (("bench", "calibration", "--out", "x", "--also", "friction"), "table_friction"),
        (("doctor", "--model", "softbar"), "soft_bar"),
        (("train", "--model", "soft_bar", "--out", "polices/pi0"), "policies"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else None,
)
def test_a_misspelt_name_gets_the_right_one_as_a_suggestion(refused, tmp_path, arguments, meant):
    (tmp_path / "actions.csv").write_text("dx_m,dz_m\n0.01,0.0\n")
    (tmp_path / "policies").mkdir()
    refused(*arguments, says=(f"did you mean `{meant}`?",), code=USAGE)
    assert {path.name for path in tmp_path.iterdir()} <= {"actions.csv", "policies", "x"}


@pytest.mark.parametrize(
    ("old", "new", "meant"),
    [
        ("keypoint_noise_px:", "keypoint_nose_px:", "keypoint_noise_px"),
        ("density_kg_m3:", "densty_kg_m3:", "density_kg_m3"),
        ("name: table_friction", "name: tabel_friction", "table_friction"),
    ],
)
def test_a_misspelt_name_in_a_model_file_gets_the_right_one_as_a_suggestion(refused, tmp_path, old, new, meant):
    (tmp_path / "model.yaml").write_text(MODEL.read_text().replace(old, new))
    refused("infer", BAG, "--model", "model.yaml", "--out", "x", says=("model.yaml", f"did you mean `{meant}`?"), code=USAGE)


@pytest.mark.parametrize("arguments", [("-p", "max_age:=1.0"), ("--params-file", "parms.yaml")], ids=["parameter", "file"])
def test_a_misspelt_argument_of_a_node_gets_the_right_one_as_a_suggestion(refused, tmp_path, arguments):
    (tmp_path / "params.yaml").write_text("")
    meant = {"-p": "max_age_s", "--params-file": "params.yaml"}[arguments[0]]
    says = (f"did you mean `{meant}`?",)
    refused("node", "policy_runner", "--ros-args", *arguments, says=says, code=USAGE, speaker="policy_runner")


def test_a_name_that_resembles_nothing_gets_no_suggestion(program, tmp_path):
    done = program("effects", "--name", "zzz", folder=tmp_path)
    assert done.returncode == USAGE and "did you mean" not in done.stderr


def test_every_command_takes_bags_as_an_argument_or_as_an_option(program, refused, tmp_path):
    plain, option = program("info", BAG, folder=tmp_path), program("info", "--bag", BAG, folder=tmp_path)
    assert plain.returncode == option.returncode == 0 and plain.stdout == option.stdout
    twice = program("info", BAG, "--bag", BAG, folder=tmp_path)
    assert twice.stdout == f"{plain.stdout}\n{plain.stdout}"
    for bags in ((BAG, "--bag", "nowhere"), ("--bag", BAG, "nowhere"), ("nowhere", BAG)):
        refused("infer", *bags, "--model", MODEL, "--out", "x", says=NO_BAG, code=USAGE)
        refused("find-effects", *bags, "--model", MODEL, "--out", "x", says=NO_BAG, code=USAGE)
    refused("replay", BAG, "--bag", BAG, says=("expected one bag, got 2", BAG), code=USAGE)
    refused("reindex", "--bag", "nowhere", says=NO_BAG, code=USAGE)
    for record in (("record", BAG), ("record", "--bag", BAG), ("record", "--out", BAG)):
        refused(*record, says=(BAG, "expected a folder that does not exist yet"), code=USAGE)
    refused("record", "a", "--out", "b", says=("BAG", "--out"), code=USAGE)
    refused("infer", "--model", MODEL, "--out", "x", says=("BAG",), code=USAGE)


def test_a_value_outside_the_prior_gives_a_warning_and_an_impossible_one_is_refused(program, refused, tmp_path):
    (tmp_path / "actions.csv").write_text("dx_m,dz_m\n0.01,0.0\n")
    wanted = ("simulate", "--model", "soft_bar", "--actions", "actions.csv", "--fidelity", "fast")
    inside = program(*wanted, "--theta", "length_m=0.25", folder=tmp_path)
    assert inside.returncode == 0 and inside.stderr == "", inside.stderr
    outside = program(*wanted, "--theta", "length_m=0.32", "--effect", "table_friction=2", folder=tmp_path)
    assert outside.returncode == 0, outside.stderr
    first, second = outside.stderr.splitlines()
    assert first.startswith("catenary: warning: --theta length_m=0.32") and "uniform 0.195 to 0.305" in first
    assert second.startswith("catenary: warning: --effect table_friction=2") and "0.3 to 0.6" in second
    refused(*wanted, "--theta", "length_m=90", says=("--theta length_m", "0.01 to 10", "90"), code=USAGE)
    refused(*wanted, "--effect", "table_friction=-1", says=("--effect table_friction", "0 to 5", "-1"), code=USAGE)


def test_a_training_into_a_missing_folder_is_refused_before_it_begins(refused, tmp_path):
    says = ("--out new/pi0", "no folder new", "mkdir -p new")
    refused("train", "--model", MODEL, "--out", "new/pi0", says=says, code=USAGE)
    assert not (tmp_path / "new").exists()


def test_a_closed_pipe_ends_a_command_quietly(tmp_path):
    for arguments in ("--help", "effects", f"info {BAG}", "node", "node camera --help", "infer --help"):
        line = f"set -o pipefail; '{PROGRAM}' {arguments} | true"
        done = subprocess.run(["bash", "-c", line], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.stderr == "", arguments
        # 141: ended by SIGPIPE. 0: all was written before the reader ended.
        assert done.returncode in (0, 141), arguments


def test_a_cell_outside_the_prior_runs_with_a_warning(program):
    arguments = ("--ros-args", "-p", f"model_file:={MODEL}", "-p", "theta:=[0.32, 1e4]", "-p", "fidelity:=fine_mesh")
    cell = program.start("node", "simulated_cell", *arguments)
    try:
        said = next(line for line in cell.stderr if "outside its prior" in line)
    finally:
        cell.terminate()
        cell.communicate(timeout=20)
    assert "WARN" in said and "length_m 0.32" in said and "uniform 0.195 to 0.305" in said, said


@pytest.mark.parametrize("command", ["record", "demo", "launch", "node"])
@pytest.mark.parametrize(
    ("variable", "value"), [("ROS_DOMAIN_ID", "999"), ("ROS_DOMAIN_ID", "lab"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")]
)
def test_a_wrong_environment_is_named(refused, tmp_path, command, variable, value):
    arguments = {"record": ("--out", "bag"), "demo": ("--out", "demo"), "launch": (LAUNCH,), "node": ("camera",)}[command]
    speaker = "camera" if command == "node" else "catenary"
    refused(command, *arguments, says=(variable, value, "expected"), speaker=speaker, **{variable: value})
    assert not list(tmp_path.iterdir()), "something was written all the same"


def test_a_domain_without_a_free_port_is_named(program, refused):
    # RTPS 2.5, section 9.6.2.3: the discovery port of participant p in domain d is 7400 + 250 d + 10 + 2 p.
    sockets = []
    try:
        for participant in range(120):
            sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            # A port that another process has is as good as one that this test takes.
            with contextlib.suppress(OSError):
                sockets[-1].bind(("0.0.0.0", 7400 + 250 * program.domain + 10 + 2 * participant))
        says = (f"domain {program.domain}", "expected a free UDP port", "ROS_DOMAIN_ID")
        refused("node", "camera", says=says, code=1, speaker="camera")
        refused("record", "--out", "bag", says=says, code=1)
    finally:
        for used in sockets:
            used.close()
