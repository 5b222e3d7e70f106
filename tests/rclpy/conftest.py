"""Processes of a test in a domain of their own, and a node of rclpy beside them: those of the tests of the graph."""

import importlib.util
import itertools
import os
import pathlib
import signal
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("graph_fixtures", ROOT / "tests/graph/conftest.py")
graph_fixtures = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(graph_fixtures)

numbers = itertools.count(os.getpid())


class Session(graph_fixtures.Session):
    """Processes of one test. Domains lie beside those of the graph's tests."""

    program = graph_fixtures.PROGRAM

    def __init__(self, folder):
        super().__init__(folder)
        self.domain = 57 + next(numbers) % 43
        self.environment["ROS_DOMAIN_ID"] = str(self.domain)

    def join(self):
        """A node of rclpy in the domain."""
        self.ros = graph_fixtures.Ros(self.domain)
        return self.ros

    def record(self, name, *arguments):
        """A recorder of the bag called `name`, which subscribes by now."""
        recorder = self.start("record", "--out", name, "--json", *arguments, name=name)
        self.wait_for(lambda: recorder.poll() is not None or (self.folder / name).exists(), 20, f"the bag {name}")
        return recorder

    def stop(self, *children):
        """Ends recorders in order."""
        for child in children:
            child.send_signal(signal.SIGINT)
        for child in children:
            assert child.wait(20) == 0

    def wait_for_readers(self, publisher, count):
        """Waits until `count` subscriptions are matched, and have heard of it."""
        self.wait_for(lambda: publisher.get_subscription_count() >= count, 20, f"{count} readers of {publisher.topic}")
        time.sleep(0.3)


@pytest.fixture
def session(tmp_path):
    assert graph_fixtures.PROGRAM.exists(), f"{graph_fixtures.PROGRAM} is missing: cargo build --release"
    session = Session(tmp_path)
    try:
        yield session
    finally:
        session.end()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """Shows what the processes said where a test fails."""
    report = yield
    for session in graph_fixtures.running if report.failed else []:
        for path in sorted(session.folder.glob("*.err")):
            report.sections.append((path.name, "\n".join(path.read_text(errors="replace").splitlines()[-40:])))
    return report


def messages_of(bag):
    """Topic to its messages as bytes, from rosbags and from mcap-ros2-support, which must agree."""
    from mcap_ros2.reader import read_ros2_messages
    from rosbags.highlevel import AnyReader

    found, decoded = {}, {}
    with AnyReader([bag]) as reader:
        names = {connection.topic: connection.msgtype for connection in reader.connections}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(bytes(data))
    for path in sorted(bag.glob("*.mcap"), key=lambda p: int(p.stem.rsplit("_", 1)[1])):
        for message in read_ros2_messages(str(path)):
            assert message.ros_msg is not None
            decoded[message.channel.topic] = decoded.get(message.channel.topic, 0) + 1
    assert decoded == {topic: len(messages) for topic, messages in found.items()}
    return names, found


@pytest.fixture(scope="session")
def read_bag():
    return messages_of


def make_room(folder, size):
    """Mounts a file system of `size` bytes; whether this is permitted."""
    folder.mkdir()
    return os.system(f"mount -t tmpfs -o size={size} tmpfs '{folder}' 2>/dev/null") == 0


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 1 MiB; none where mounting is not permitted."""
    folder = tmp_path / "disk"
    mounted = make_room(folder, 2**20)
    yield folder if mounted else None
    if mounted:
        os.system(f"umount -l '{folder}'")
