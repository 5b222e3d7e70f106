"""Nodes leave the graph as soon as they end, whatever ends them, so that nobody meets endpoints of a dead node."""

import os
import signal

import pytest
from std_srvs.srv import SetBool

from support.policy import policy_file
from support.program import MODEL

MODEL_FILE = ("-p", f"model_file:={MODEL}")

# Every node with the parameters that it needs to start.
NODES = {
    "simulated_cell": MODEL_FILE,
    "camera": (),
    "keypoint_tracker": (),
    "panda_bridge": (),
    "policy_runner": MODEL_FILE,
    "simulator_pool": (),
    "bayes_sim": (),
    "effect_finder": (),
    "ppo_trainer": (),
    "recorder": ("-p", "output:=recorded"),
}


def names(ros):
    return set(ros.node.get_node_names())


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_every_node_leaves_the_graph_as_it_ends(session, ending):
    children = [session.node(node, *arguments) for node, arguments in NODES.items()]
    ros = session.meet(*NODES)
    for child in children:
        child.send_signal(ending)
    codes = {node: child.wait(10) for node, child in zip(NODES, children, strict=True)}
    assert ros.holds_within(lambda: not names(ros) & set(NODES), 2), f"ghosts: {names(ros) & set(NODES)}"
    assert set(codes.values()) == {0}, codes


def test_an_interrupted_command_leaves_the_graph(session):
    (session.folder / "policy").write_bytes(policy_file())
    deploy = session.start("deploy", "--policy", "policy")
    ros = session.meet("deploy")
    deploy.send_signal(signal.SIGINT)
    deploy.wait(10)
    assert ros.holds_within(lambda: "deploy" not in names(ros), 2)


def enable(ros):
    return ros.call(SetBool, "/panda/enable", SetBool.Request(data=True))


def test_a_restarted_node_or_launch_meets_no_dead_one(session):
    nodes = {"simulated_cell", "camera", "keypoint_tracker", "policy_runner"}
    launch = session.launch("learning:=false", nodes=nodes)
    ros, first = session.ros, session.pid_of("policy_runner")
    os.kill(first, signal.SIGINT)
    session.wait_for(lambda: session.pid_of("policy_runner") not in (None, first), 10, "a new runner")
    one = lambda: len(ros.node.get_publishers_info_by_topic("/panda/target_pose")) == 1
    assert ros.holds_within(one, 5), "the runner that ended still commands"
    answer = enable(ros)
    assert answer.success, answer.message
    session.stop(launch)
    assert ros.holds_within(lambda: not names(ros) & nodes, 2), names(ros)
    ros.close()
    session.launch("learning:=false", nodes=nodes)
    answer = enable(session.ros)
    assert answer.success, answer.message
