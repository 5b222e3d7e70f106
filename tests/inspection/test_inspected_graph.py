"""catenary-inspect on the running graph of a simulated cell."""

import array
import json
import subprocess

import pytest
from catenary_inspect.main import main
from catenary_msgs.action import Infer, RunEpisode
from rclpy.qos import QoSProfile, ReliabilityPolicy

from support.contract import NODES, TOPICS
from support.pictures import is_picture
from support.policy import BIAS, policy_file
from support.program import BAG, MODEL
from support.ros import Goal

STEPS = 3
STREAMS = {row.name: row for row in TOPICS if row.hz}


@pytest.fixture
def figures(graph, monkeypatch, figures):
    """Runs a command in the graph's domain; returns the document that it prints."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    return figures


def test_a_running_episode_is_followed_to_its_end(graph, tmp_path):
    picture = tmp_path / "episode.png"
    environment = graph.environment | {"ROS_DOMAIN_ID": str(graph.domain)}
    command = ["catenary-inspect", "episode", "--json", "--out", picture, "--seconds", "60"]
    listener = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    graph.ros.wait_for(lambda: "catenary_inspect" in graph.ros.node.get_node_names(), 20, "the listener")
    # The listener subscribes to topics as it discovers their publishers.
    graph.ros.spin(2)
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), policy_name="constant", run_all_steps=True, max_steps=STEPS)
    result = Goal(graph.ros, RunEpisode, "/policy_runner/run_episode", goal).result()
    out, err = listener.communicate(timeout=30)
    assert listener.returncode == 0, err
    said = json.loads(out)
    told = next(e for e in said["episodes"] if e["episode"] == said["shown"])
    assert (told["episode"], told["policy"], told["actions"], told["end"]) == (result.episode, "constant", STEPS, result.end)
    assert told["return"] == pytest.approx(result.episode_return) and told["rejected"] == 0 and told["poses"] > 50
    assert [row["dx_mm"] for row in said["steps"]] == pytest.approx([60 * BIAS[0]] * STEPS)
    assert is_picture(picture)


def test_the_latched_posterior_is_read(graph, figures, tmp_path):
    sizes = {"iterations": 1, "simulations": 30}
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=MODEL.read_text(), preset="networks", **sizes)
    result = Goal(graph.ros, Infer, "/bayes_sim/infer", goal, seconds=60).result()
    said = figures("posterior", "--out", tmp_path / "posterior.png")
    assert said["components"] == len(result.posterior.weights) and is_picture(tmp_path / "posterior.png")
    assert [m["name"] for m in said["marginals"]] == ["length_m", "youngs_modulus_pa"]
    # The result tells the share before the mixture was widened.
    assert result.mass_outside - 0.03 <= said["mass_outside"] < 1.0


def test_keypoints_and_latencies_are_those_of_the_stream(figures, tmp_path):
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


def test_a_graph_with_a_clock_is_shown(session, monkeypatch, capsys):
    session.node("keypoint_tracker", "-p", "use_sim_time:=true")
    session.start("replay", BAG, "--clock", "--loop", "--topics", "/dlo/keypoints", "/panda/current_pose")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(session.domain))
    session.meet("keypoint_tracker")
    assert main(["graph", "--seconds", "1.5", "--json"]) == 0, capsys.readouterr().err
    said = json.loads(capsys.readouterr().out)
    topics = {topic["name"]: topic for topic in said["topics"]}
    assert topics["/clock"]["type"] == "rosgraph_msgs/msg/Clock" and topics["/clock"]["rate_hz"] > 50
    assert [p for topic in said["topics"] for p in topic["problems"]] == []


def test_a_missing_topic_is_named(session, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(session.domain))
    assert main(["keypoints"]) == 1
    said = capsys.readouterr().err
    assert "/dlo/keypoints" in said and "no publisher" in said and "ROS_DOMAIN_ID" in said
