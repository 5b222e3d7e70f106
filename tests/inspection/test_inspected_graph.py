"""catenary-inspect on the running graph of a simulated cell."""

import array
import json
import subprocess

import pytest
from catenary_inspect.main import main
from catenary_msgs.action import Infer, RunEpisode
from contract import NODES, TOPICS
from policy import BIAS, policy_file
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from test_inspected_bags import is_picture

STEPS = 3
STREAMS = {row.name: row for row in TOPICS if row.hz}


@pytest.fixture
def figures(graph, monkeypatch, capsys):
    """Figures of a command that runs in the graph's domain."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))

    def run(*arguments):
        assert main([*map(str, arguments), "--json"]) == 0, capsys.readouterr().err
        return json.loads(capsys.readouterr().out)

    return run


def start(graph, kind, name, goal):
    client = ActionClient(graph.ros.node, kind, name)
    graph.ros.wait_for(client.server_is_ready, 20, f"the server of {name}")
    handle = graph.ros.result(client.send_goal_async(goal), 20, "an answer to the goal")
    assert handle.accepted
    return handle.get_result_async()


def test_an_episode_that_runs_is_followed_to_its_end(graph, tmp_path):
    picture = tmp_path / "episode.png"
    environment = graph.environment | {"ROS_DOMAIN_ID": str(graph.domain)}
    command = ["catenary-inspect", "episode", "--json", "--out", picture, "--seconds", "60"]
    listener = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    graph.ros.wait_for(lambda: "catenary_inspect" in graph.ros.node.get_node_names(), 20, "the listener")
    graph.ros.holds_within(lambda: False, 2)
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), policy_name="constant", run_all_steps=True, max_steps=STEPS)
    result = graph.ros.result(start(graph, RunEpisode, "/policy_runner/run_episode", goal), 30, "the episode").result
    out, err = listener.communicate(timeout=30)
    assert listener.returncode == 0, err
    said = json.loads(out)
    told = next(e for e in said["episodes"] if e["episode"] == said["shown"])
    assert (told["episode"], told["policy"], told["actions"], told["end"]) == (result.episode, "constant", STEPS, result.end)
    assert told["return"] == pytest.approx(result.episode_return) and told["rejected"] == 0 and told["poses"] > 50
    assert [row["dx_mm"] for row in said["steps"]] == pytest.approx([60 * BIAS[0]] * STEPS)
    assert is_picture(picture)


def test_the_latched_posterior_is_read(graph, figures, tmp_path):
    model = (graph.root / "launch_configs/models/soft_bar.yaml").read_text()
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(graph.root / "bags/swing")], model_yaml=model, iterations=1, simulations=30)
    result = graph.ros.result(start(graph, Infer, "/bayes_sim/infer", goal), 60, "the posterior").result
    said = figures("posterior", "--out", tmp_path / "posterior.png")
    assert said["components"] == len(result.posterior.weights) and is_picture(tmp_path / "posterior.png")
    assert [m["name"] for m in said["marginals"]] == ["length_m", "youngs_modulus_pa"]
    assert said["mass_outside"] == pytest.approx(result.mass_outside, abs=0.03)


def test_keypoints_and_latencies_are_those_of_the_stream(graph, figures, tmp_path):
    said = figures("keypoints", "--seconds", 1.5, "--out", tmp_path / "keypoints.png")
    assert said["rate_hz"] > 20 and all(point["seen"] > 0.9 for point in said["points"]) and is_picture(tmp_path / "keypoints.png")
    rows = {row["topic"]: row for row in figures("latency", "--seconds", 1.5, "--out", tmp_path / "latency.png")["topics"]}
    assert {"/dlo/mask", "/dlo/keypoints", "/panda/current_pose", "/panda/arm_state"} <= set(rows) and is_picture(tmp_path / "latency.png")
    for name in ("/dlo/keypoints", "/panda/current_pose"):
        assert STREAMS[name].hz / 4 < rows[name]["rate_hz"] < 1.1 * STREAMS[name].hz
        assert 0 < rows[name]["age"]["p50_ms"] < 500


def test_the_graph_names_nodes_topics_and_profiles_that_do_not_fit(graph, figures, tmp_path):
    row = STREAMS["/panda/current_pose"]
    deaf = graph.ros.node.create_subscription(row.kind, row.name, print, QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE))
    said = figures("graph", "--seconds", 1.5, "--out", tmp_path / "graph.png")
    graph.ros.node.destroy_subscription(deaf)
    assert {f"/{node}" for node in NODES} <= set(said["nodes"]) and is_picture(tmp_path / "graph.png")
    topics = {topic["name"]: topic for topic in said["topics"]}
    for wanted in (w for w in TOPICS if w.publishers):
        found = topics[wanted.name]
        assert found["type"] == wanted.type_name and set(found["publishers"]) >= {f"/{node}" for node in wanted.publishers}
        assert found["profile"] == f"{wanted.reliability}, {wanted.durability}".replace("_", " ")
    problems = [problem for topic in said["topics"] for problem in topic["problems"]]
    assert problems == [f"{row.name}: /stranger asks for reliable and hears nothing of /simulated_cell, which offers best effort"]


def test_a_graph_with_a_clock_and_with_types_that_nobody_has_is_shown(session, monkeypatch, capsys):
    session.node("keypoint_tracker", "-p", "use_sim_time:=true")
    session.start("replay", session.root / "bags/swing", "--clock", "--loop", "--topics", "/dlo/keypoints", "/panda/current_pose")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(session.domain))
    session.meet("keypoint_tracker")
    assert main(["graph", "--seconds", "1.5", "--json"]) == 0, capsys.readouterr().err
    said = json.loads(capsys.readouterr().out)
    topics = {topic["name"]: topic for topic in said["topics"]}
    assert topics["/clock"]["type"] == "rosgraph_msgs/msg/Clock" and topics["/clock"]["rate_hz"] > 50
    assert [p for topic in said["topics"] for p in topic["problems"]] == []


def test_a_graph_without_what_is_needed_is_said(session, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(session.domain))
    assert main(["keypoints"]) == 1
    said = capsys.readouterr().err
    assert "/dlo/keypoints" in said and "no publisher" in said and "ROS_DOMAIN_ID" in said
