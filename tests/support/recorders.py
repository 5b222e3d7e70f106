"""Recorders beside publishers of rclpy, and their bags as rosbags and mcap-ros2-support read them."""

import signal
import time

from .ros import Ros


def join(session):
    """Starts a node of rclpy in the session's domain."""
    session.ros = Ros(session.domain)
    return session.ros


def record(session, name, *arguments):
    """Starts a recorder of the bag called `name`; returns when it subscribes."""
    recorder = session.start("record", "--out", name, "--json", *arguments, name=name)
    session.wait_for(lambda: recorder.poll() is not None or (session.folder / name).exists(), 20, f"the bag {name}")
    return recorder


def stop(*recorders):
    """Interrupts recorders, which have to end well."""
    for recorder in recorders:
        recorder.send_signal(signal.SIGINT)
    for recorder in recorders:
        assert recorder.wait(20) == 0


def wait_for_readers(session, publisher, count):
    """Waits until `count` subscriptions are matched on both sides."""
    session.wait_for(lambda: publisher.get_subscription_count() >= count, 20, f"{count} readers of {publisher.topic}")
    # The readers may know of the match a little later than the publisher, and lose messages of best effort until then.
    time.sleep(0.3)


def read_bag(bag):
    """Types by topic, and serialised messages by topic, as rosbags reads them; mcap-ros2-support has to find as many."""
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
