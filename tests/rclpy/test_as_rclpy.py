"""A node of ours answers the tools of ROS 2 as a node of rclpy does."""

import subprocess
import sys

import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters, GetParameters, GetParameterTypes
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from type_description_interfaces.srv import GetTypeDescription

from support.program import MODEL, ROOT
from support.rosidl import type_hashes

MODEL_FILE = f"model_file:={MODEL}"


@pytest.fixture(scope="module")
def cell(session_of_module):
    """A simulated cell and a bridge, and a node of rclpy beside them."""
    session_of_module.node("simulated_cell", "-p", MODEL_FILE, "-p", "use_sim_time:=true")
    session_of_module.node("panda_bridge")
    session_of_module.meet("simulated_cell", "panda_bridge")
    return session_of_module


def test_the_clock_has_one_type(cell):
    types = lambda: dict(cell.ros.node.get_topic_names_and_types()).get("/clock")
    cell.ros.wait_for(types, 5, "a subscription of the clock")
    assert types() == ["rosgraph_msgs/msg/Clock"]
    # Only the cell runs under simulated time.
    readers = cell.ros.node.get_subscriptions_info_by_topic("/clock")
    assert [reader.node_name for reader in readers if reader.node_name != "stranger"] == ["simulated_cell"]


def test_parameter_events_are_offered_as_by_rclpy(cell):
    node = cell.ros.node
    ours = [p for p in node.get_publishers_info_by_topic("/parameter_events") if p.node_name != node.get_name()]
    (theirs,) = [p for p in node.get_publishers_info_by_topic("/parameter_events") if p.node_name == node.get_name()]
    assert sorted(p.node_name for p in ours) == ["panda_bridge", "simulated_cell"]
    for publisher in ours:
        profile = publisher.qos_profile
        assert publisher.topic_type == "rcl_interfaces/msg/ParameterEvent"
        assert (profile.reliability, profile.durability) == (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)
        assert (profile.deadline, profile.lifespan) == (theirs.qos_profile.deadline, theirs.qos_profile.lifespan)


@pytest.mark.parametrize("names", [["no_such_thing"], ["use_sim_time", "no_such_thing"], []])
def test_unknown_parameters_are_answered_as_by_rclpy(cell, names):
    own = cell.ros.node.get_name()
    for kind, name, field in (
        (GetParameters, "get_parameters", "values"),
        (GetParameterTypes, "get_parameter_types", "types"),
        (DescribeParameters, "describe_parameters", "descriptors"),
    ):
        ours, theirs = (
            list(getattr(cell.ros.call(kind, f"/{node}/{name}", kind.Request(names=names)), field)) for node in ("simulated_cell", own)
        )
        assert ours == theirs == [], name


TYPES = {
    "rcl_interfaces/msg/ParameterEvent": ParameterEvent,
    "rcl_interfaces/srv/DescribeParameters": DescribeParameters,
    "type_description_interfaces/srv/GetTypeDescription": GetTypeDescription,
}


HASHES = type_hashes()


@pytest.mark.parametrize("name", TYPES)
@pytest.mark.parametrize("sources", [True, False])
def test_types_are_described_as_by_rclpy(cell, name, sources):
    request = GetTypeDescription.Request(type_name=name, type_hash=HASHES[name], include_type_sources=sources)
    ours, theirs = (
        cell.ros.call(GetTypeDescription, f"/{node}/get_type_description", request) for node in ("simulated_cell", cell.ros.node.get_name())
    )
    assert theirs.successful, theirs.failure_reason
    assert ours.successful, ours.failure_reason
    assert ours.type_description == theirs.type_description
    by_name = lambda answer: sorted((s.type_name, s.encoding, s.raw_file_contents) for s in answer.type_sources)
    assert by_name(ours) == by_name(theirs)


@pytest.mark.parametrize("text", ["", "RIHS01_0", HASHES["std_msgs/msg/Float32MultiArray"]])
def test_types_that_a_node_does_not_use_are_refused_as_by_rclpy(cell, text):
    request = GetTypeDescription.Request(type_name="std_msgs/msg/Float32MultiArray", type_hash=text)
    ours, theirs = (
        cell.ros.call(GetTypeDescription, f"/{node}/get_type_description", request) for node in ("simulated_cell", cell.ros.node.get_name())
    )
    assert (ours.successful, ours.failure_reason) == (theirs.successful, theirs.failure_reason)
    assert not ours.successful


# Script for a network namespace with the MTU of Ethernet: asks a node for the descriptions of all its parameters at once.
ASK = """
import sys
sys.path.insert(0, sys.argv[1])
import pathlib, tempfile
from rcl_interfaces.srv import DescribeParameters, ListParameters
from support.session import session_in
with tempfile.TemporaryDirectory() as folder, session_in(pathlib.Path(folder)) as session:
    session.node("panda_bridge")
    ros = session.meet("panda_bridge")
    names = ros.call(ListParameters, "/panda_bridge/list_parameters", ListParameters.Request()).result.names
    answer = ros.call(DescribeParameters, "/panda_bridge/describe_parameters", DescribeParameters.Request(names=names), 5)
    assert [d.name for d in answer.descriptors] == list(names), answer
    print(sum(len(d.description) for d in answer.descriptors))
"""


def test_an_answer_beyond_the_mtu_reaches_rclpy(tmp_path):
    net = "ip link set lo up mtu 1500 && ip link set lo multicast on && ip route add 224.0.0.0/4 dev lo"
    own = ["unshare", "--user", "--map-root-user", "--net", "sh", "-c"]
    if subprocess.run([*own, net], capture_output=True, check=False).returncode:
        pytest.skip("this machine gives no network of its own: unshare --user --net")
    script = tmp_path / "ask.py"
    script.write_text(ASK)
    command = [*own, f'{net} && exec "$@"', "sh", sys.executable, script, ROOT / "tests"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1000, "the answer fits into one packet"
