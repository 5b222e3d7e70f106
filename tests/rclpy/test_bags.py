"""Our bags in other readers: rosbags, mcap-ros2-support, and the deserialiser of rclpy."""

import importlib
import math
import subprocess

import pytest

from support.cdr import same
from support.program import ROOT
from support.stamps import stamp_ns

# Type, reliability, durability and depth of each topic of the sample bag.
TOPICS = {
    "/dlo/keypoints": ("catenary_msgs/msg/Keypoints", "BEST_EFFORT", "VOLATILE", 1),
    "/episode/event": ("catenary_msgs/msg/EpisodeEvent", "RELIABLE", "TRANSIENT_LOCAL", 16),
    "/panda/arm_state": ("catenary_msgs/msg/ArmState", "RELIABLE", "TRANSIENT_LOCAL", 1),
    "/panda/current_pose": ("geometry_msgs/msg/PoseStamped", "BEST_EFFORT", "VOLATILE", 1),
    "/panda/external_wrench": ("geometry_msgs/msg/WrenchStamped", "BEST_EFFORT", "VOLATILE", 1),
    "/panda/target_pose": ("geometry_msgs/msg/PoseStamped", "RELIABLE", "VOLATILE", 1),
    "/policy/action": ("catenary_msgs/msg/EefDelta", "RELIABLE", "VOLATILE", 10),
    "/policy/observation": ("catenary_msgs/msg/Observation", "RELIABLE", "VOLATILE", 10),
}
COUNTS = {
    "/dlo/keypoints": 83,
    "/episode/event": 2,
    "/panda/arm_state": 21,
    "/panda/current_pose": 206,
    "/panda/external_wrench": 206,
    "/panda/target_pose": 8,
    "/policy/action": 8,
    "/policy/observation": 9,
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The sample bag, made anew by the example `make_sample_bag`."""
    folder = tmp_path_factory.mktemp("bags") / "swing"
    command = ["cargo", "run", "--quiet", "--release", "-p", "catenary_bag", "--example", "make_sample_bag", "--", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True)
    return folder


def test_rosbags_reads_every_message(bag):
    from rosbags.highlevel import AnyReader

    counts, last = {}, 0
    with AnyReader([bag]) as reader:
        assert reader.message_count == sum(COUNTS.values())
        assert reader.duration > 4 * 10**9
        for connection in reader.connections:
            type_name, reliability, durability, depth = TOPICS[connection.topic]
            (profile,) = connection.ext.offered_qos_profiles
            assert connection.msgtype == type_name
            assert (profile.reliability.name, profile.durability.name, profile.depth) == (reliability, durability, depth)
            assert profile.history.name == "KEEP_LAST"
            assert connection.digest.startswith("RIHS01_")
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            assert time - stamp_ns(message.header.stamp) == 500_000
            assert time >= last
            last = time
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
            if connection.topic == "/panda/current_pose":
                q = message.pose.orientation
                assert math.isclose(math.hypot(q.x, q.y, q.z, q.w), 1.0)
    assert counts == COUNTS


def test_mcap_ros2_support_reads_every_message(bag):
    from mcap_ros2.reader import read_ros2_messages

    counts, steps = {}, []
    for message in read_ros2_messages(str(bag / "swing_0.mcap")):
        stamped_ns = stamp_ns(message.ros_msg.header.stamp)
        assert (message.log_time_ns, message.publish_time_ns) == (stamped_ns + 500_000, stamped_ns)
        counts[message.channel.topic] = counts.get(message.channel.topic, 0) + 1
        if message.channel.topic == "/policy/observation":
            assert len(message.ros_msg.values) == 12
            steps.append(message.ros_msg.step)
    assert counts == COUNTS
    assert steps == list(range(9))


def test_the_file_has_the_layout_of_rosbag2(bag):
    from mcap.reader import make_reader
    from ruamel.yaml import YAML

    outside = YAML(typ="safe").load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    with open(bag / "swing_0.mcap", "rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        (record,) = [r for r in reader.iter_metadata() if r.name == "rosbag2"]
        assert YAML(typ="safe").load(record.metadata["serialized_metadata"]) == outside
        summary = reader.get_summary()
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        for channel in summary.channels.values():
            assert channel.message_encoding == "cdr"
            assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert outside["version"] == 9 and outside["storage_identifier"] == "mcap"
    assert outside["relative_file_paths"] == ["swing_0.mcap"]
    assert outside["starting_time"]["nanoseconds_since_epoch"] == 99_900_500_000
    assert outside["duration"]["nanoseconds"] == 4_100_000_000


def test_rclpy_deserialises_every_message_to_the_same_values(bag):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    from rclpy.serialization import deserialize_message

    counts = {}
    with open(bag / "swing_0.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            package, kind, name = schema.name.split("/")
            cls = getattr(importlib.import_module(f"{package}.{kind}"), name)
            assert same(deserialize_message(message.data, cls), decoded), channel.topic
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert counts == COUNTS
