"""Every topic of the contract between rclpy and our nodes, and through a bag: what counts up on one side comes out on the other.

The recorder is the node that subscribes all of them, the replayer the one that publishes all. What the nodes of a cell say
on them is for test_cell.py.
"""

import itertools
import time

import pytest
from catenary_msgs.msg import ArmState
from cdr import counted_message, pieces
from conftest import Ros
from contract import BY_NAME, TOPICS
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rcl_interfaces.msg import Log
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from std_srvs.srv import Trigger

COUNT = 3
ROWS = pytest.mark.parametrize("row", TOPICS, ids=lambda row: row.name)


def messages_of(row, index):
    """Different ones for each topic."""
    return [counted_message(row.kind, [1 + 7 * index + number]) for number in range(COUNT)]


SENT = {row.name: messages_of(row, index) for index, row in enumerate(TOPICS)}


def same(message, other):
    """Whether an rclpy message and that of another reader have the same values."""
    if hasattr(message, "get_fields_and_field_types"):
        return all(same(getattr(message, name), getattr(other, name)) for name in message.get_fields_and_field_types())
    if hasattr(message, "__len__") and not isinstance(message, str | bytes):
        return len(message) == len(other) and all(map(same, message, other))
    if isinstance(message, bytes):
        other = other if isinstance(other, bytes) else bytes([other])
    return message == other


@pytest.fixture(scope="module")
def bag(session_of_module):
    """A bag of what rclpy published on every topic."""
    session = session_of_module
    folder = session.folder / "bag"
    names = "[" + ", ".join(row.name for row in TOPICS) + "]"
    recorder = session.node("recorder", "-p", f"output:={folder}", "-p", f"topics:={names}")
    session.wait_for(folder.exists, 20, "the recorder's bag")
    session.meet()
    ros = session.ros
    publishers = {row.name: ros.node.create_publisher(row.kind, row.name, row.profile) for row in TOPICS}
    matched = lambda: all(p.get_subscription_count() == 1 for p in publishers.values())  # noqa: E731
    ros.wait_for(matched, 20, "the recorder's subscriptions")
    # The recorder may know the publishers a little later than they know it, and the best effort then loses their first. The
    # pause is in the bag, too, and gives rclpy its time in the replay.
    ros.holds_within(lambda: False, 0.5)
    publishers["/rosout"].publish(Log(msg="the first one"))
    ros.holds_within(lambda: False, 0.5)
    for number, row in itertools.product(range(COUNT), TOPICS):
        publishers[row.name].publish(SENT[row.name][number])
        ros.holds_within(lambda: False, 0.005)
    ros.holds_within(lambda: False, 1)
    session.stop(recorder)
    ros.close()
    return folder


@pytest.fixture(scope="module")
def in_bag(bag):
    """Type and bytes of what is in the bag by topic, what two other readers make of them, and rosbags' connections."""
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
    """Without the log lines and parameters that nodes publish by themselves."""
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
    """What rclpy heard when the replayer played the bag, and whom it heard, by topic."""
    session = session_of_module
    session.ros = ros = Ros(session.domain)
    heard = {row.name: [] for row in TOPICS}
    for row in TOPICS:
        ros.node.create_subscription(row.kind, row.name, heard[row.name].append, row.profile_of_depth(max(row.depth, 10)))
    # Targets are replayed where an arm is served that says it is simulated.
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
    # The replayer's own logs go by /rosout, too.
    for publisher in publishers[row.name]:
        profile = publisher.qos_profile
        assert (profile.reliability.name.lower(), profile.durability.name.lower()) == (row.reliability, row.durability)
        assert publisher.topic_type == row.type_name
    assert publishers[row.name]
