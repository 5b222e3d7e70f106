"""How nodes leave the graph: at once, however they end, so that nobody meets a ghost."""

import signal
import time

import pytest
from conftest import ROOT
from catenary_msgs.action import Infer
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
