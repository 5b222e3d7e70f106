"""Every topic of the contract between rclpy and our nodes, and through a bag, with messages whose fields count up.

The recorder subscribes all topics and the replayer publishes all. test_cell.py checks the messages of the other nodes.
"""

import itertools
import time

import pytest
from catenary_msgs.msg import ArmState
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rcl_interfaces.msg import Log
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from std_srvs.srv import Trigger

from support.cdr import counted_message, pieces, same
from support.contract import BY_NAME, TOPICS
from support.ros import Ros

COUNT = 3
ROWS = pytest.mark.parametrize("row", TOPICS, ids=lambda row: row.name)


def messages_of(row, index):
    """Messages of a topic, different from those of every other topic."""
    return [counted_message(row.kind, [1 + 7 * index + number]) for number in range(COUNT)]


SENT = {row.name: messages_of(row, index) for index, row in enumerate(TOPICS)}


@pytest.fixture(scope="module")
def bag(session_of_module):
    """Bag of the messages that rclpy published on every topic."""
    session = session_of_module
    folder = session.folder / "bag"
    names = "[" + ", ".join(row.name for row in TOPICS) + "]"
    recorder = session.node("recorder", "-p", f"output:={folder}", "-p", f"topics:={names}")
    session.wait_for(folder.exists, 20, "the recorder's bag")
    session.meet()
    ros = session.ros
    publishers = {row.name: ros.node.create_publisher(row.kind, row.name, row.profile) for row in TOPICS}
    matched = lambda: all(p.get_subscription_count() == 1 for p in publishers.values())
    ros.wait_for(matched, 20, "the recorder's subscriptions")
    # The recorder may match the publishers a little later than they match it, and messages of best effort are lost until then.
    # The pause is in the bag, too, and gives rclpy time to match the replayer.
    ros.spin(0.5)
    publishers["/rosout"].publish(Log(msg="the first one"))
    ros.spin(0.5)
    for number, row in itertools.product(range(COUNT), TOPICS):
        publishers[row.name].publish(SENT[row.name][number])
        ros.spin(0.005)
    ros.spin(1)
    session.stop(recorder)
    ros.close()
    return folder


@pytest.fixture(scope="module")
def in_bag(bag):
    """Content of the bag by topic: types and bytes, messages of two other readers, and connections of rosbags."""
    raw, by_mcap, by_rosbags = {}, {}, {}
    with open(bag / "bag_0.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, value in reader.iter_decoded_messages():
            raw.setdefault(channel.topic, []).append((schema.name, message.data))
            by_mcap.setdefault(channel.topic, []).append(value)
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            by_rosbags.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
        connections = {connection.topic: connection for connection in reader.connections}
    return raw, (by_mcap, by_rosbags), connections


def ours(row, messages):
    """Messages that these tests sent, without the log lines and reports that nodes publish by themselves."""
    return [message for message in messages if any(message == sent for sent in SENT[row.name])]


@ROWS
def test_rclpy_to_node(in_bag, row):
    found = in_bag[0][row.name]
    assert {name for name, _ in found} == {row.type_name}
    kept = [(data, message) for _, data in found if (message := deserialize_message(data, row.kind)) in SENT[row.name]]
    assert [message for _, message in kept] == SENT[row.name]
    for data, message in kept:
        (our_pieces, our_end), (their_pieces, _) = pieces(data, message), pieces(serialize_message(message), message)
        assert our_pieces == their_pieces and our_end == len(data)


@ROWS
def test_bag(in_bag, row):
    _, readers, connections = in_bag
    connection = connections[row.name]
    (profile,) = connection.ext.offered_qos_profiles
    stated = (profile.reliability.name.lower(), profile.durability.name.lower(), profile.depth)
    assert stated == (row.reliability, row.durability, row.depth)
    assert connection.msgtype == row.type_name and connection.digest.startswith("RIHS01_")
    for read in readers:
        for sent in SENT[row.name]:
            assert any(same(sent, message) for message in read[row.name])


@pytest.fixture(scope="module")
def replayed(session_of_module, bag):
    """Messages that rclpy heard from the replayer, and the replayer's publishers, by topic."""
    session = session_of_module
    session.ros = ros = Ros(session.domain)
    heard = {row.name: [] for row in TOPICS}
    for row in TOPICS:
        ros.node.create_subscription(row.kind, row.name, heard[row.name].append, row.profile_of_depth(max(row.depth, 10)))
    # The replayer publishes targets only beside an arm that says it is simulated.
    arm = ros.node.create_publisher(ArmState, "/panda/arm_state", BY_NAME["/panda/arm_state"].profile)
    ros.node.create_service(Trigger, "/panda/hold", lambda request, response: response)
    ros.node.create_timer(0.1, lambda: arm.publish(ArmState(is_sim=True)))
    options = ("wait_s:=10.0", "allow_replay:=true", "allow_others:=true")
    time.sleep(1)
    replayer = session.node("replayer", "-p", f"bag:={bag}", *(part for option in options for part in ("-p", option)))
    publishers = {}

    def ended():
        for row in TOPICS:
            there = [p for p in ros.node.get_publishers_info_by_topic(row.name) if p.node_name == "replayer"]
            publishers[row.name] = there or publishers.get(row.name, [])
        return replayer.poll() is not None

    ros.wait_for(ended, 30, "the end of the replay")
    assert replayer.returncode == 0, session.text("replayer.err")
    return heard, publishers


@ROWS
def test_node_to_rclpy(replayed, row):
    heard, publishers = replayed
    assert ours(row, heard[row.name]) == SENT[row.name]
    # More than one on /rosout, which carries the replayer's own log, too.
    for publisher in publishers[row.name]:
        profile = publisher.qos_profile
        assert (profile.reliability.name.lower(), profile.durability.name.lower()) == (row.reliability, row.durability)
        assert publisher.topic_type == row.type_name
    assert publishers[row.name]
