"""`catenary replay` beside rclpy: its topics, their names and profiles, its timing and its clock."""

import itertools
import json
import signal
import time

import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped
from mcap.writer import Writer as McapWriter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from support.program import BAG
from support.recorders import join, record, stop
from support.stamps import stamp_ns

# Reliability and durability of the replayed topics of the sample bag.
OFFERED = {
    "/dlo/keypoints": ("BEST_EFFORT", "VOLATILE"),
    "/episode/event": ("RELIABLE", "TRANSIENT_LOCAL"),
    "/panda/arm_state": ("RELIABLE", "TRANSIENT_LOCAL"),
    "/panda/current_pose": ("BEST_EFFORT", "VOLATILE"),
    "/panda/external_wrench": ("BEST_EFFORT", "VOLATILE"),
    "/policy/action": ("RELIABLE", "VOLATILE"),
    "/policy/observation": ("RELIABLE", "VOLATILE"),
}
# Topics of every node.
BASIC = {"/clock", "/parameter_events", "/rosout"}
# Time of the first message of the sample bag.
START_NS = 99_900_500_000


def published(ros):
    """Reliability and durability by topic of the replayer, once it has created its publishers."""
    node = lambda: [n for n in ros.node.get_node_names() if n == "replayer"]
    ros.wait_for(node, 20, "the replayer")

    def topics():
        found = dict(ros.node.get_publisher_names_and_types_by_node("replayer", "/"))
        return {topic for topic in found if topic not in BASIC - {"/clock"}}

    ros.wait_for(topics, 20, "its topics")
    # rclpy discovers the publishers one after the other, so this waits until no new one comes in 0.5 s.
    while (before := topics()) != (ros.spin(0.5) or topics()):
        assert before
    found = {}
    for topic in topics():
        (info,) = [i for i in ros.node.get_publishers_info_by_topic(topic) if i.node_name == "replayer"]
        found[topic] = (info.qos_profile.reliability.name, info.qos_profile.durability.name)
    return found


def only(*topics):
    return {topic: OFFERED[topic] for topic in topics}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), OFFERED),
        (("--topics", "/dlo/keypoints", "policy/*", "--exclude-topics", "/policy/action"), only("/dlo/keypoints", "/policy/observation")),
        (("-e", "/policy/.*|arm_state"), only("/policy/action", "/policy/observation")),
        (("-x", "/panda/.*", "--topics", "/dlo/keypoints", "--regex", ".*(pose|event)"), only("/dlo/keypoints", "/episode/event")),
    ],
    ids=["all", "names", "regex", "both"],
)
def test_chosen_topics_are_offered_with_their_recorded_profiles(session, arguments, expected):
    ros = join(session)
    session.start("replay", BAG, "--loop", *arguments)
    assert published(ros) == expected


def test_topics_are_renamed_and_offered_with_the_profiles_of_a_file(session):
    ros = join(session)
    overrides = session.folder / "overrides.yaml"
    overrides.write_text(
        "/dlo/keypoints:\n  reliability: reliable\n  history: keep_all\n/episode/event:\n  durability: volatile\n"
        "/panda/arm_state:\n  reliability: best_effort\n  durability: volatile\n"
    )
    remaps = ("--remap", "/dlo/keypoints:=/lab/points", "/panda/arm_state:=/lab/state")
    topics = ("--topics", "/dlo/keypoints", "/episode/event", "/panda/arm_state", "/clock*")
    replay = session.start("replay", BAG, "-l", *topics, *remaps, "--qos-profile-overrides-path", overrides, "--clock", 50)
    assert published(ros) == {
        "/lab/points": ("RELIABLE", "VOLATILE"),
        "/lab/state": ("BEST_EFFORT", "VOLATILE"),
        "/episode/event": ("RELIABLE", "VOLATILE"),
        "/clock": ("BEST_EFFORT", "VOLATILE"),
    }
    replay.send_signal(signal.SIGINT)
    assert replay.wait(10) == 130 and session.text("replay.out").count("messages published") == 1


def test_a_part_is_played_again_and_again_with_its_clock(session):
    """Replays the second from 2 s to 3 s at half the speed, with 40 ticks of the clock a second."""
    ros = join(session)
    poses, ticks = [], []
    best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    arrived = lambda messages: lambda message: messages.append((time.monotonic(), message))
    ros.node.create_subscription(PoseStamped, "/panda/current_pose", arrived(poses), best_effort)
    ros.node.create_subscription(Clock, "/clock", arrived(ticks), best_effort)
    part = ("--start-offset", 2, "--playback-duration", 1, "--rate", 0.5, "--clock", 40, "--loop", "--topics", "/panda/current_pose")
    session.start("replay", BAG, *part)
    rounds = lambda: sum(stamp_ns(b[1].clock) < stamp_ns(a[1].clock) for a, b in itertools.pairwise(ticks))
    ros.wait_for(lambda: rounds() >= 2, 30, "two rounds")
    stamps = [stamp_ns(message.header.stamp) for _, message in poses]
    # Each message was logged half a millisecond after its stamp.
    first, last = START_NS + 2 * 10**9 - 500_000, START_NS + 3 * 10**9
    assert min(stamps) >= first and max(stamps) <= last
    assert min(stamps) < first + 10**8 and max(stamps) > last - 10**8
    assert any(b < a for a, b in itertools.pairwise(stamps)), "the poses did not come again"
    steps = enumerate(itertools.pairwise(ticks), 1)
    turns = [0] + [i for i, (a, b) in steps if stamp_ns(b[1].clock) < stamp_ns(a[1].clock)]
    whole = ticks[turns[1] : turns[2]]
    times = [stamp_ns(message.clock) for _, message in whole]
    assert times == sorted(times) and times[0] >= first and times[-1] <= last
    # One second of the bag takes two, so 80 ticks; a busy machine loses some of them, which are best effort.
    assert 60 <= len(whole) <= 81, len(whole)
    assert whole[-1][0] - whole[0][0] == pytest.approx(2 * (times[-1] - times[0]) / 1e9, abs=0.15)


THING = "std_msgs/Header header\nfloat64[] values\n"


def test_topics_of_any_type_are_replayed_unchanged(session):
    """Replays types of other packages: some that rclpy knows, and one that only the bag defines."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(THING, "lab_msgs/msg/Thing"))
    kinds = {"/lab/notes": "std_msgs/msg/String", "/lab/number": "std_msgs/msg/Int32", "/lab/thing": "lab_msgs/msg/Thing"}
    with Writer(session.folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for number in range(10):
            note = store.types["std_msgs/msg/String"](data=f"nöte {number}")
            writer.write(topics["/lab/notes"], 10**9 + number, store.serialize_cdr(note, "std_msgs/msg/String"))
            count = store.types["std_msgs/msg/Int32"](data=number)
            writer.write(topics["/lab/number"], 10**9 + number, store.serialize_cdr(count, "std_msgs/msg/Int32"))
        writer.write(topics["/lab/thing"], 10**9, b"\0\1\0\0" + bytes(40))
    ros = join(session)
    notes = []
    ros.node.create_subscription(String, "/lab/notes", notes.append, QoSProfile(depth=100))
    replay = session.start("replay", "bag", "--json", "--delay", 0.5)
    ros.wait_for(lambda: len(notes) == 10, 20, "ten notes")
    assert [note.data for note in notes] == [f"nöte {number}" for number in range(10)]
    assert replay.wait(20) == 0
    report = json.loads(session.text("replay.out"))
    assert (report["published"], report["failed"], report["left_out"]) == (21, 0, [])


def bag_of(folder, messages):
    """Writes a bag of the rows of `messages(types)`: topic, type, time in ns and message."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {}
        for name, kind, at_ns, message in messages(store.types):
            topic = topics.get(name) or topics.setdefault(name, writer.add_connection(name, kind, typestore=store))
            writer.write(topic, at_ns, store.serialize_cdr(message, kind))


def pose_of(types):
    """A PoseStamped of rosbags."""
    time_ns, header = types["builtin_interfaces/msg/Time"](sec=1, nanosec=0), types["std_msgs/msg/Header"]
    point, turn = types["geometry_msgs/msg/Point"](x=0.4, y=0.0, z=0.3), types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    pose = types["geometry_msgs/msg/Pose"](position=point, orientation=turn)
    return types["geometry_msgs/msg/PoseStamped"](header=header(stamp=time_ns, frame_id="panda_link0"), pose=pose)


@pytest.mark.parametrize("name", ["/target_pose", "/right/controller/target_pose"])
def test_no_command_of_any_controller_is_replayed_without_permission(session, name):
    kind = "geometry_msgs/msg/PoseStamped"
    bag_of(session.folder / "bag", lambda types: [(name, kind, 10**9, pose_of(types)), ("/lab/pose", kind, 10**9, pose_of(types))])
    done = session.run("replay", "bag", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["published"] == 1 and [name in left_out and "allow_replay" in left_out for left_out in report["left_out"]] == [True]
    refused = session.run("replay", "bag", "--topics", name)
    assert refused.returncode != 0 and "allow_replay" in refused.stderr


def test_a_replay_as_fast_as_possible_skips_no_tick_of_the_clock(session):
    """Replays two messages that are a minute apart, with 12,000 ticks between them."""
    text = lambda types: types["std_msgs/msg/String"](data="x")
    bag_of(session.folder / "bag", lambda types: [("/a", "std_msgs/msg/String", t, text(types)) for t in (10**9, 61 * 10**9)])
    ros = join(session)
    ticks = []
    profile = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
    ros.node.create_subscription(Clock, "/clock", ticks.append, profile)
    replay = session.start("replay", "bag", "--rate", "inf", "--clock", "--delay", 1)
    ros.wait_for(lambda: replay.poll() is not None, 60, "the end of the replay")
    times = [stamp_ns(tick.clock) for tick in ticks]
    assert replay.returncode == 0 and times == sorted(times)
    # A replay that skips ticks has two of them, at the messages. How many of 12,000 best-effort ticks arrive is up to the machine.
    steps_ns = [b - a for a, b in itertools.pairwise([10**9, *times, 61 * 10**9])]
    assert len(times) > 1000 and all(step % (5 * 10**6) == 0 for step in steps_ns), (len(times), max(steps_ns))


def notes_at(session, *times_ns):
    """Writes a bag of notes with these times."""
    text = lambda types: types["std_msgs/msg/String"](data="x")
    bag_of(session.folder / "bag", lambda types: [("/a", "std_msgs/msg/String", t, text(types)) for t in times_ns])


def test_an_override_of_a_topic_that_is_not_played_or_recorded_is_named(session):
    notes_at(session, 10**9)
    (session.folder / "q.yaml").write_text("/elsewhere: {reliability: reliable}\n")
    done = session.run("replay", "bag", "--rate", "inf", "--qos-profile-overrides-path", "q.yaml")
    assert done.returncode == 0 and "/elsewhere: its QoS override has no effect" in done.stderr, done.stderr
    recorder = session.start("record", "--out", "new", "--qos-profile-overrides-path", "q.yaml")
    session.wait_for(lambda: "/elsewhere: its QoS override has no effect so far" in session.text("record.err"), 20, "the warning")
    session.stop(recorder)


def test_a_negative_duration_is_no_limit(session):
    notes_at(session, 10**9, 2 * 10**9)
    done = session.run("replay", "bag", "--playback-duration", -1, "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["published"] == 2, done.stderr


def test_a_loop_without_messages_ends_with_an_error(session):
    notes_at(session, 10**9, 11 * 10**9)
    done = session.run("replay", "bag", "--loop", "--start-offset", 2, "--playback-duration", 1)
    assert done.returncode != 0 and "loop: expected messages to publish between the start and the end" in done.stderr


def test_a_message_with_an_impossible_time_is_left_out(session):
    with open(session.folder / "bag.mcap", "wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/a", "cdr", schema)
        for time_ns in (10**9, 2**64 - 1, 2**64 - 2, 2 * 10**9):
            writer.add_message(channel, time_ns, b"\0\1\0\0\2\0\0\0x\0", time_ns)
        writer.finish()
    report = json.loads(session.run("info", "bag.mcap", "--json").stdout)
    assert (report["messages"], report["readable"]) == (4, 4)
    for more in ((), ("--clock",)):
        done = session.run("replay", "bag.mcap", "--json", *more)
        report = json.loads(done.stdout)
        assert (done.returncode, report["published"], report["failed"]) == (0, 2, 2), done.stderr
        named = f"/a: 2 messages are logged more than ten years away from the rest, at {2**64 - 2} ns, {2**64 - 1} ns"
        assert named in done.stderr, done.stderr


def test_messages_in_other_encodings_are_left_out_and_named(session):
    with open(session.folder / "mixed.mcap", "wb") as target:
        writer = McapWriter(target)
        writer.start("ros2")
        number = writer.register_schema("std_msgs/msg/Int32", "ros2msg", b"int32 data\n")
        thing = writer.register_schema("thing", "jsonschema", b"{}")
        pose = writer.register_schema("geometry_msgs/msg/PoseStamped", "jsonschema", b"{}")
        channels = [("/a", "cdr", number), ("/b", "json", thing), ("/c", "json", pose), ("/d", "", 0)]
        for topic, encoding, schema in channels:
            writer.add_message(writer.register_channel(topic, encoding, schema), 1, b"\0\1\0\0\7\0\0\0", 1)
        writer.finish()
    report = json.loads(session.run("replay", "mixed.mcap", "--json").stdout)
    found = {"/b": "thing in json", "/c": "geometry_msgs/msg/PoseStamped in json", "/d": "no type in no encoding"}
    assert report["published"] == 1
    assert report["left_out"] == [f"{topic}: expected messages in cdr, got {kind}" for topic, kind in found.items()]
    shown = session.run("info", "mixed.mcap").stdout
    assert all(f"{topic} [{kind}]" in shown for topic, kind in found.items())
    topics = json.loads(session.run("info", "mixed.mcap", "--json").stdout)["topics"]
    assert [topic["encoding"] for topic in topics] == ["cdr", "json", "json", ""]


def test_late_subscribers_get_the_static_transforms_of_every_broadcaster(session):
    """Records latched transforms of two broadcasters with a later recorder, and replays the bag from a later time on."""
    ros = join(session)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for child in ("camera", "object"):
        frame = TransformStamped(child_frame_id=child)
        frame.header.frame_id = "panda_link0"
        ros.node.create_publisher(TFMessage, "/tf_static", latched).publish(TFMessage(transforms=[frame]))
    note = ros.node.create_publisher(String, "/lab/note", QoSProfile(depth=10))
    recorder = record(session, "bag", "--topics", "/tf_static", "/lab/note")
    ros.wait_for(lambda: note.get_subscription_count() > 0, 20, "the recorder")
    time.sleep(1.5)
    note.publish(String(data="x"))
    time.sleep(0.5)
    stop(recorder)
    counts = {topic["name"]: topic["messages"] for topic in json.loads(session.run("info", "bag", "--json").stdout)["topics"]}
    assert counts == {"/tf_static": 2, "/lab/note": 1}
    ros.close()
    other = join(session)
    session.start("replay", "bag", "--start-offset", 1, "--delay", 0, "--rate", 0.1, "--allow-others")
    other.wait_for(lambda: "replayer" in other.node.get_node_names(), 20, "the replayer")
    time.sleep(4)
    frames = []
    late = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    other.node.create_subscription(TFMessage, "/tf_static", lambda m: frames.extend(t.child_frame_id for t in m.transforms), late)
    other.wait_for(lambda: {"camera", "object"} <= set(frames), 10, f"both frames, not {frames}")
