"""Recorders beside publishers of rclpy, and what two readers of others find in the bags."""

import signal
import time

from conftest import Ros


def join(session):
    """A node of rclpy in the session's domain."""
    session.ros = Ros(session.domain)
    return session.ros


def record(session, name, *arguments):
    """A recorder of the bag called `name`, which subscribes by now."""
    recorder = session.start("record", "--out", name, "--json", *arguments, name=name)
    session.wait_for(lambda: recorder.poll() is not None or (session.folder / name).exists(), 20, f"the bag {name}")
    return recorder


def stop(*recorders):
    """Ends recorders in order."""
    for recorder in recorders:
        recorder.send_signal(signal.SIGINT)
    for recorder in recorders:
        assert recorder.wait(20) == 0


def wait_for_readers(session, publisher, count):
    """Waits until `count` subscriptions are matched, and have heard of it."""
    session.wait_for(lambda: publisher.get_subscription_count() >= count, 20, f"{count} readers of {publisher.topic}")
    time.sleep(0.3)


def read_bag(bag):
    """Types by topic, and messages as bytes by topic, from rosbags; mcap-ros2-support must find as many."""
    from mcap_ros2.reader import read_ros2_messages
    from rosbags.highlevel import AnyReader

    found, decoded = {}, {}
    with AnyReader([bag]) as reader:
        names = {connection.topic: connection.msgtype for connection in reader.connections}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(bytes(data))
    for path in bag.glob("*.mcap"):
        for message in read_ros2_messages(str(path)):
            assert message.ros_msg is not None
            decoded[message.channel.topic] = decoded.get(message.channel.topic, 0) + 1
    assert decoded == {topic: len(messages) for topic, messages in found.items()}
    return names, found
