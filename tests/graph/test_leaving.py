"""How nodes leave the graph: at once, however they end, so that nobody meets a ghost."""

import os
import signal

import pytest
from conftest import ROOT
from policy import policy_file
from std_srvs.srv import SetBool

MODEL = ("-p", f"model_file:={ROOT}/launch_configs/models/soft_bar.yaml")

# Every node of ours, with the parameters that it does not start without.
NODES = {
    "simulated_cell": MODEL,
    "camera": (),
    "keypoint_tracker": (),
    "panda_bridge": (),
    "policy_runner": MODEL,
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


def test_a_command_leaves_the_graph_as_it_is_interrupted(session):
    (session.folder / "policy").write_bytes(policy_file())
    deploy = session.start("deploy", "--policy", "policy")
    ros = session.meet("deploy")
    deploy.send_signal(signal.SIGINT)
    deploy.wait(10)
    assert ros.holds_within(lambda: "deploy" not in names(ros), 2)


def enable(ros):
    return ros.call(SetBool, "/panda/enable", SetBool.Request(data=True))


def test_what_is_started_anew_meets_no_ghost(session):
    nodes = {"simulated_cell", "camera", "keypoint_tracker", "policy_runner"}
    launch = session.launch("learning:=false", nodes=nodes)
    ros, first = session.ros, session.pid_of("policy_runner")
    os.kill(first, signal.SIGINT)
    session.wait_for(lambda: session.pid_of("policy_runner") not in (None, first), 10, "a new runner")
    one = lambda: len(ros.node.get_publishers_info_by_topic("/panda/target_pose")) == 1  # noqa: E731
    assert ros.holds_within(one, 5), "the runner that ended still commands"
    answer = enable(ros)
    assert answer.success, answer.message
    session.stop(launch)
    assert ros.holds_within(lambda: not names(ros) & nodes, 2), names(ros)
    ros.close()
    session.launch("learning:=false", nodes=nodes)
    answer = enable(session.ros)
    assert answer.success, answer.message
