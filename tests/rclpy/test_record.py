"""`catenary record` beside publishers of rclpy: its choice of topics, its profiles, and its bag after every kind of end."""

import itertools
import json
import os
import resource
import signal
import subprocess
import time

import pytest
from catenary_msgs.msg import EefDelta, EpisodeEvent
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML
from std_msgs.msg import Int32, String

from support.recorders import join, read_bag, record, stop, wait_for_readers

RELIABLE = QoSProfile(depth=1000)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def pose(number):
    """Pose with a number in x."""
    message = PoseStamped()
    message.pose.position.x = float(number)
    return message


def numbers(bag, topic):
    """Numbers of the poses of a topic, which `pose` puts into x."""
    with AnyReader([bag]) as reader:
        chosen = [c for c in reader.connections if c.topic == topic]
        return [int(reader.deserialize(data, c.msgtype).pose.position.x) for c, _, data in reader.messages(chosen)]


def test_filters_choose_the_topics_that_ros2_bag_chooses(session):
    """Runs recorders with different filters beside one publisher of each topic."""
    ros = join(session)
    publishers = {
        "/lab/notes": (String, String(data="ünï")),
        "/lab/number": (Int32, Int32(data=7)),
        "/lab/other": (Int32, Int32(data=8)),
        "/lab/_hidden": (Int32, Int32(data=9)),
        "/panda/target_pose": (PoseStamped, pose(1)),
    }
    writers = {topic: ros.node.create_publisher(kind, topic, RELIABLE) for topic, (kind, _) in publishers.items()}
    recorders = {
        "all": ["--all", "--exclude-topics", "/lab/other", "/tf", "--compression", "lz4"],
        "regex": ["-e", "^/lab/n", "--exclude-regex", "umber$"],
        "named": ["--topics", "/lab/number", "/panda/*", "/lab/_hidden", "--exclude-topic-types", "catenary_msgs/msg/ArmState"],
        "types": ["--topic-types", "std_msgs/msg/Int32", "--compression", "none"],
        "usual": ["--exclude-regex", "^/dlo|^/rosout"],
    }
    running = {name: record(session, name, *arguments) for name, arguments in recorders.items()}
    readers = {"/lab/notes": 2, "/lab/number": 3, "/lab/other": 1, "/lab/_hidden": 2, "/panda/target_pose": 3}
    for topic, count in readers.items():
        wait_for_readers(session, writers[topic], count)
    for topic, (_, message) in publishers.items():
        writers[topic].publish(message)
    time.sleep(1.5)
    stop(*running.values())

    expected = {
        "all": {"/lab/notes", "/lab/number", "/panda/target_pose"},
        "regex": {"/lab/notes"},
        "named": {"/lab/number", "/panda/target_pose", "/lab/_hidden"},
        "types": {"/lab/number", "/lab/other", "/lab/_hidden"},
        "usual": {"/panda/target_pose"},
    }
    for name, topics in expected.items():
        names, found = read_bag(session.folder / name)
        ours = {topic for topic in found if topic in publishers}
        assert ours == topics, name
        for topic in ours:
            kind, message = publishers[topic]
            assert names[topic] == f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            # Decoded, because the bytes may differ in padding, which Fast CDR leaves uninitialised.
            assert [deserialize_message(data, kind) for data in found[topic]] == [message], (name, topic)
        report = json.loads(session.text(f"{name}.out"))
        assert dict(report["topics"])[sorted(topics)[0]] == 1
    with Reader(session.folder / "usual") as reader:
        listed = {connection.topic for connection in reader.connections}
    assert "/policy/action" in listed and not listed & {"/dlo/keypoints", "/rosout", "/clock", "/lab/notes"}
    with Reader(session.folder / "named") as reader:
        listed = {connection.topic for connection in reader.connections}
    assert "/panda/current_pose" in listed and "/panda/arm_state" not in listed


def test_a_topic_that_cannot_be_recorded_is_named(session):
    """Records a type that no installed package has, a misspelt name, and a publisher whose profile offers too little."""
    ros = join(session)
    number = ros.node.create_publisher(Int32, "/lab/number", RELIABLE)
    targets = ros.node.create_publisher(PoseStamped, "/panda/target_pose", BEST_EFFORT)
    latched = ros.node.create_publisher(PoseStamped, "/lab/latched", LATCHED)
    latched.publish(pose(5))
    overrides, strict = session.folder / "overrides.yaml", session.folder / "strict.yaml"
    overrides.write_text("/panda/target_pose:\n  reliability: best_effort\n  history: keep_last\n  depth: 50\n")
    strict.write_text("/panda/target_pose:\n  reliability: reliable\n")
    session.environment.pop("AMENT_PREFIX_PATH", None)
    topics = ("--topics", "/panda/target_pose", "/lab/number", "/dlo/keypoint", "/lab/latched")
    deaf = record(session, "deaf", *topics, "--qos-profile-overrides-path", strict)
    hearing = record(session, "hearing", *topics, "--qos-profile-overrides-path", overrides)
    wait_for_readers(session, targets, 1)
    wait_for_readers(session, latched, 2)
    session.wait_for(lambda: "nobody publishes it yet" in session.text("deaf.err"), 10, "the warning")
    for x in range(20):
        targets.publish(pose(x))
        time.sleep(0.01)
    time.sleep(0.3)
    stop(deaf, hearing)
    words = session.text("deaf.err")
    assert "/lab/number: not recorded: std_msgs/msg/Int32 is not built in" in words and "AMENT_PREFIX_PATH" in words
    assert "/dlo/keypoint: nobody publishes it yet; did you mean /dlo/keypoints?" in words
    assert "/panda/target_pose: a publisher offers less than reliable, depth 1, and is not recorded" in words
    assert "/panda/target_pose" not in session.text("hearing.err")
    assert number.get_subscription_count() == 0
    assert numbers(session.folder / "deaf", "/panda/target_pose") == []
    # A busy machine loses some messages of best effort.
    assert len(numbers(session.folder / "hearing", "/panda/target_pose")) > 10
    for name in ("deaf", "hearing"):
        assert numbers(session.folder / name, "/lab/latched") == [5]
        with Reader(session.folder / name) as reader:
            (profile,) = [c.ext.offered_qos_profiles[0] for c in reader.connections if c.topic == "/lab/latched"]
        assert (profile.reliability.name, profile.durability.name) == ("RELIABLE", "TRANSIENT_LOCAL")


def test_topics_of_the_contract_are_subscribed_with_the_offered_profile(session):
    """Starts publishers that offer less than the contract, and one that comes too late for another subscription."""
    ros = join(session)
    volatile = QoSProfile(depth=100)
    recorder = record(session, "bag", "--topics", "/panda/target_pose", "/policy/action", "/panda/current_pose", "/episode/event")
    targets = ros.node.create_publisher(PoseStamped, "/panda/target_pose", BEST_EFFORT)
    events = ros.node.create_publisher(EpisodeEvent, "/episode/event", volatile)
    actions = ros.node.create_publisher(EefDelta, "/policy/action", RELIABLE)
    for writer in (targets, events, actions):
        wait_for_readers(session, writer, 1)
    for number in range(20):
        targets.publish(pose(number))
        events.publish(EpisodeEvent(episode=number))
        actions.publish(EefDelta())
        time.sleep(0.02)
    late = ros.node.create_publisher(EefDelta, "/policy/action", BEST_EFFORT)
    what = "/policy/action: a publisher offers less than reliable, depth 10, and is not recorded"
    session.wait_for(lambda: what in session.text("bag.err"), 10, "the warning")
    assert late.get_subscription_count() == 0
    for _ in range(5):
        actions.publish(EefDelta())
    time.sleep(0.3)
    stop(recorder)
    found = read_bag(session.folder / "bag")[1]
    episodes = [deserialize_message(data, EpisodeEvent).episode for data in found["/episode/event"]]
    assert episodes == list(range(20)) and len(found["/policy/action"]) == 25
    # A busy machine loses some messages of best effort.
    assert len(found["/panda/target_pose"]) > 10


def test_bags_are_split_by_time_and_by_size(session):
    ros = join(session)
    writer = ros.node.create_publisher(PoseStamped, "/panda/target_pose", RELIABLE)
    by_time = record(session, "by_time", "--topics", "/panda/target_pose", "--max-bag-duration", 1)
    by_size = record(session, "by_size", "--topics", "/panda/target_pose", "-b", 8192, "--compression", "none")
    wait_for_readers(session, writer, 2)
    for number in range(250):
        writer.publish(pose(number))
        time.sleep(0.01)
    time.sleep(0.3)
    stop(by_time, by_size)
    for name, files in (("by_time", range(3, 5)), ("by_size", range(3, 9))):
        bag = session.folder / name
        paths = [bag / f"{name}_{i}.mcap" for i in range(len(list(bag.glob("*.mcap"))))]
        assert len(paths) in files and sorted(paths) == sorted(bag.glob("*.mcap"))
        assert sorted(p.name for p in bag.iterdir()) == sorted(["metadata.yaml", *(p.name for p in paths)])
        assert numbers(bag, "/panda/target_pose") == list(range(250))
        assert len(read_bag(bag)[1]["/panda/target_pose"]) == 250
        metadata = YAML(typ="safe").load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        assert [file["path"] for file in metadata["files"]] == metadata["relative_file_paths"] == [p.name for p in paths]
        spans = [(f["starting_time"]["nanoseconds_since_epoch"], f["duration"]["nanoseconds"]) for f in metadata["files"]]
        for (start, duration), (following, _) in itertools.pairwise(spans):
            assert start + duration < following
            if name == "by_time":
                assert duration <= 10**9 < following - start
        if name == "by_size":
            assert all(path.stat().st_size >= 8192 for path in paths[:-1])
    # One file of a bag is a bag, too.
    half = json.loads(session.run("info", session.folder / "by_time/by_time_1.mcap", "--json").stdout)
    whole = json.loads(session.run("info", session.folder / "by_time", "--json").stdout)
    assert whole["messages"] == 250 and len(whole["files"]) > 2 and 50 < half["messages"] < 150 and whole["notes"] == []


def test_a_killed_recorder_loses_the_last_second_at_most_and_its_bag_is_finished(session):
    ros = join(session)
    writer = ros.node.create_publisher(PoseStamped, "/panda/target_pose", RELIABLE)
    recorder = record(session, "bag", "--topics", "/panda/target_pose")
    wait_for_readers(session, writer, 1)
    sent = []
    for number in range(330):
        writer.publish(pose(number))
        sent.append(time.monotonic())
        time.sleep(0.01)
    recorder.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    recorder.wait(5)
    bag = session.folder / "bag"
    before = json.loads(session.run("info", bag, "--json").stdout)
    assert "was not finished and has no summary" in before["notes"][0]
    done = session.run("reindex", bag)
    assert done.returncode == 0 and "was not finished" in done.stdout, done.stderr
    after = json.loads(session.run("info", bag, "--json").stdout)
    assert (after["messages"], after["notes"]) == (before["messages"], [])
    read = numbers(bag, "/panda/target_pose")
    assert read == list(range(before["messages"])) and len(read_bag(bag)[1]["/panda/target_pose"]) == len(read)
    assert sorted(path.name for path in bag.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    # The promise is 1 s; 0.4 s are for a busy machine to write it.
    assert killed - sent[len(read) - 1] < 1.4, f"{killed - sent[len(read) - 1]:.2f} s lost"


@pytest.fixture
def small_disk(tmp_path):
    """Folder on a disk of 1 MiB; None if mounting is not permitted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", folder]
    mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    yield folder if mounted else None
    if mounted:
        subprocess.run(["umount", "-l", folder], check=True)


def fill(session, recorder, writer):
    """Publishes messages of 20 kB of random text, a hundred times a second, until the recorder ends."""
    wait_for_readers(session, writer, 1)
    for number in range(1000):
        if recorder.poll() is not None:
            break
        writer.publish(String(data=f"{number:4}" + os.urandom(10_000).hex()))
        time.sleep(0.01)
    assert recorder.wait(10) == 1


def kept(bag):
    """Numbers of the messages of `fill` in a bag."""
    with AnyReader([bag]) as reader:
        return [int(reader.deserialize(data, c.msgtype).data[:4]) for c, _, data in reader.messages()]


def test_a_full_disk_ends_the_recording_with_a_bag_that_every_reader_reads(session, small_disk):
    if small_disk is None:
        pytest.skip("mounting a small file system is not permitted here")
    ros = join(session)
    writer = ros.node.create_publisher(String, "/lab/notes", RELIABLE)
    bag = small_disk / "bag"
    recorder = session.start("record", "--out", bag, "--topics", "/lab/notes", "--compression", "none", "--json")
    session.wait_for(lambda: recorder.poll() is not None or bag.exists(), 20, "the bag")
    fill(session, recorder, writer)
    said = session.text("record.err").splitlines()[-1]
    assert "cannot write any further: No space left on device" in said and session.text("record.out") == ""
    found = kept(bag)
    assert len(found) > 20 and found == list(range(len(found)))
    assert f"the {len(found)} messages up to the last complete chunk are safe" in said
    assert len(read_bag(bag)[1]["/lab/notes"]) == len(found)
    assert json.loads(session.run("info", bag, "--json").stdout)["notes"] == []
    assert sorted(path.name for path in bag.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


def test_a_limit_on_the_size_of_files_ends_the_recording_with_whole_chunks(session):
    """Limits the size of files as `ulimit -f` does, in place of a full disk, which needs the right to mount one."""
    ros = join(session)
    writer = ros.node.create_publisher(String, "/lab/notes", RELIABLE)
    arguments = ["--out", "bag", "--topics", "/lab/notes", "--compression", "none"]
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))
    recorder = session.start("record", *arguments, preexec_fn=limit)
    session.wait_for(lambda: recorder.poll() is not None or (session.folder / "bag").exists(), 20, "the bag")
    fill(session, recorder, writer)
    said = session.text("record.err").splitlines()[-1]
    assert "cannot write any further: File too large" in said and "messages up to the last complete chunk are safe" in said
    done = session.run("reindex", "bag")
    assert done.returncode == 0, done.stderr
    found = kept(session.folder / "bag")
    assert len(found) > 5 and found == list(range(len(found))) and f"the {len(found)} messages" in said
