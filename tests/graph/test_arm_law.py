"""A policy and the arm it meets: the bridge announces its law, commands compare it with that of the training, and training asks for it."""

import json

import pytest
from catenary_msgs.action import RunEpisode
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from support.policy import policy_file
from support.program import MODEL
from support.ros import Goal
from support.session import session_in

FAST_LAG = '{"lag": {"time_constant_s": 0.08, "max_speed_m_s": 0.5}}'
MODELS_LAG = '{"lag": {"time_constant_s": 0.16, "max_speed_m_s": 0.5}}'
# A short, stiff bar, which hangs still soon.
STIFF = "cell_theta:=[0.2,45000.0]"


@pytest.fixture(scope="module", params=["sim", "emulated"])
def graph(request, tmp_path_factory):
    with session_in(tmp_path_factory.mktemp(request.param)) as session:
        session.cell = request.param
        own = {"policy_runner", "simulated_cell", "camera", "keypoint_tracker"}
        address = ()
        if request.param == "emulated":
            own |= {"panda_bridge", "panda_emulator"}
            address = (f"address:=127.46.{session.domain}.1",)
        session.launch(STIFF, "learning:=false", *address, file=f"{request.param}.launch.xml", nodes=own)
        yield session


def announced(graph):
    """Text of the law that the arm announces, to a subscriber that comes late."""
    heard, profile = [], QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = graph.ros.node.create_subscription(String, "/panda/arm_law", heard.append, profile)
    graph.ros.wait_for(lambda: heard, 20, "the arm's law")
    graph.ros.node.destroy_subscription(subscription)
    return heard[-1].data


def deploy(graph, arm, *options):
    (graph.folder / "policy").write_bytes(policy_file(arm=arm))
    return graph.run("deploy", "--policy", "policy", "--wait-s", 20, *options)


def test_the_arm_announces_its_law(graph):
    law = json.loads(announced(graph))
    if graph.cell == "sim":
        assert law == json.loads(MODELS_LAG)
    else:
        law = law["impedance"]
        assert (law["stiffness_n_m"], law["clip_m"], law["max_speed_m_s"]) == (2000.0, 0.02, 0.5)


def test_a_policy_for_another_arm_is_refused_by_name_before_anything_moves(graph):
    done = deploy(graph, FAST_LAG)
    this = "a lag of 0.16 s" if graph.cell == "sim" else "an impedance of 2000 N/m and 89 N s/m with a clip of 0.02 m"
    assert done.returncode == 2, done.stderr
    assert f"was trained for a lag of 0.08 s with at most 0.5 m/s; this arm is {this}" in done.stderr
    assert "--arm running" in done.stderr and "nothing was sent" in done.stderr
    assert "move_to_start" not in graph.text("launch.err")


def test_the_runner_warns_every_client_of_a_policy_for_another_arm(graph):
    lines = graph.ros.listen_log()
    goal = Goal(graph.ros, RunEpisode, "/policy_runner/run_episode", RunEpisode.Goal(policy=policy_file(arm=FAST_LAG)))
    told = lambda: [line.msg for line in lines if "was trained for a lag of 0.08 s" in line.msg]
    graph.ros.wait_for(told, 20, "a warning of the runner")
    goal.cancel()
    goal.end()


def test_a_policy_for_this_arm_and_one_that_does_not_say_its_arm_run_without_a_warning(graph):
    for arm in (announced(graph), None):
        done = deploy(graph, arm)
        assert done.returncode == 0, done.stderr
        assert "trained for" not in done.stderr
    text = graph.text("log/policy_runner.log")
    assert text.count("was trained for") == 1, "the one of the test before"


def test_a_training_beside_a_running_graph_is_for_its_arm(graph):
    train = ("train", "--model", MODEL, "--steps", 2048, "--out")
    done = graph.run(*train, "pi.safetensors")
    assert done.returncode == 0, done.stderr
    kept = graph.run(*train, "model.safetensors", "--arm", "model")
    assert kept.returncode == 0 and "arm:" not in kept.stderr, kept.stderr
    others = graph.run("deploy", "--policy", "model.safetensors", "--wait-s", 20) if graph.cell == "emulated" else None
    score = ("evaluate", "--policy", "pi.safetensors", "--model", MODEL, "--episodes", 30, "--fidelity", "fast")
    beside = graph.run(*score)
    assert beside.returncode == 0 and "trained for" not in beside.stderr, beside.stderr
    on_the_models = graph.run(*score, "--arm", "model")
    if graph.cell == "sim":
        # The model's own law, so that the same seed gives the same bits with and without the graph.
        assert "arm:" not in done.stderr and "trained for" not in on_the_models.stderr
        assert (graph.folder / "pi.safetensors").read_bytes() == (graph.folder / "model.safetensors").read_bytes()
    else:
        assert "arm: an impedance of 2000 N/m" in done.stderr and "--arm model keeps a lag of 0.16 s" in done.stderr
        assert "simulated arm: an impedance of 2000 N/m" in done.stdout and "simulated arm" not in kept.stdout
        assert "was trained for an impedance" in on_the_models.stderr and "this arm is a lag of 0.16 s" in on_the_models.stderr
        assert others.returncode == 2 and "was trained for a lag of 0.16 s" in others.stderr, others.stderr
