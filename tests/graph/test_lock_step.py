"""The simulated cell in lock step: time waits for perception and policy, so that the load of the machine changes no bit."""

import itertools
import sys

import pytest
from catenary_msgs.action import MoveToStart, RunEpisode
from catenary_msgs.msg import EpisodeEvent
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from support.policy import policy_file
from support.ros import Goal
from support.session import session_in
from support.stamps import stamp_s

STEPS = 3
CELL = {"simulated_cell", "camera", "keypoint_tracker", "policy_runner"}
ARGUMENTS = ("learning:=false", "respawn:=false", "lock_step:=true", "real_time_factor:=1000.0", "seed:=7")
TOPICS = ("/dlo/keypoints", "/panda/current_pose", "/panda/arm_state", "/policy/observation", "/policy/action", "/panda/target_pose")
RELIABLE = "{reliability: reliable, history: keep_last, depth: 4096}"
BUSY = "while True: pass"


def recorded(session, is_busy):
    """Runs one episode in lock step and returns the bytes of its messages by topic and stamp, with stamps and wall time of its ends."""
    session.launch(*ARGUMENTS, nodes=CELL)
    loops = [session.start_script(sys.executable, "-c", BUSY, name=f"busy_{i}") for i in range(2 if is_busy else 0)]
    moved = Goal(session.ros, MoveToStart, "/panda/move_to_start", MoveToStart.Goal(settle_time=0.2), 120).result()
    assert moved.success, moved.message
    assert session.ros.call(Trigger, "/simulated_cell/still_object", Trigger.Request(), 60).success
    profiles = session.folder / "profiles.yaml"
    lossy = ("/dlo/keypoints", "/panda/current_pose")
    profiles.write_text("".join(f"{topic}: {RELIABLE}\n" for topic in lossy))
    recorder = session.start("record", "--out", "bag", "--use-sim-time", "--qos-profile-overrides-path", profiles)
    session.wait_for(lambda: (session.folder / "bag").exists(), 60, "the bag")
    episode = RunEpisode.Goal(policy=policy_file(), max_steps=STEPS, run_all_steps=True)
    ended = Goal(session.ros, RunEpisode, "/policy_runner/run_episode", episode, 300).result()
    assert ended.success, ended.message
    session.stop(recorder)
    for loop in loops:
        loop.kill()
    found, ends = {topic: {} for topic in TOPICS}, {}
    with AnyReader([session.folder / "bag"]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == "/episode/event":
                ends[message.event] = stamp_s(message.header.stamp)
            elif connection.topic in found:
                found[connection.topic].setdefault(stamp_s(message.header.stamp), []).append(bytes(data))
    start, end = ends[EpisodeEvent.STARTED], ends[EpisodeEvent.ENDED]
    inside = lambda messages: {at: data for at, data in messages.items() if start <= at <= end}
    return {topic: inside(messages) for topic, messages in found.items()}, (start, end)


def test_two_recordings_have_the_same_bits_whatever_the_load(tmp_path):
    both = []
    for is_busy in (False, True):
        folder = tmp_path / f"busy_{is_busy}"
        folder.mkdir()
        with session_in(folder) as session:
            both.append(recorded(session, is_busy))
    (first, ends), (second, others) = both
    assert ends == others
    for topic in TOPICS:
        assert first[topic].keys() == second[topic].keys(), topic
        assert first[topic] == second[topic], topic
    # 3 steps of 0.5 s, in which the arm moves; no message is missing.
    assert ends[1] - ends[0] == pytest.approx(0.5 * STEPS, abs=0.02)
    poses, frames = sorted(first["/panda/current_pose"]), sorted(first["/dlo/keypoints"])
    assert {round(b - a, 6) for a, b in itertools.pairwise(poses)} == {0.005} and (poses[0], poses[-1]) == ends
    assert max(b - a for a, b in itertools.pairwise(frames)) < 0.0201 and len(frames) > 60 * (ends[1] - ends[0])
    assert len(first["/policy/action"]) == STEPS and len(first["/policy/observation"]) == STEPS + 1
    assert len({data[0][12:] for data in first["/panda/current_pose"].values()}) > 100, "the arm did not move"


def test_time_stands_still_unless_somebody_waits_for_it(session):
    session.launch(*ARGUMENTS, nodes=CELL)
    clocks = session.ros.listen(Clock, "/clock")
    newest = lambda: [stamp_s(message.clock) for message in clocks[-5:]]
    stands = lambda since: len(clocks) >= since + 5 and len(set(newest())) == 1
    # The first frame has been taken, and nobody asks for the next.
    session.ros.wait_for(lambda: stands(0), 60, "a time that stands still")
    assert newest()[-1] == 0.005
    moved = Goal(session.ros, MoveToStart, "/panda/move_to_start", MoveToStart.Goal(settle_time=1.0), 120).result()
    assert moved.success, moved.message
    count = len(clocks)
    session.ros.wait_for(lambda: stands(count), 60, "a time that stands still after the move")
    end = newest()[-1]
    assert end > 1.0
    count = len(clocks)
    session.ros.wait_for(lambda: stands(count), 60, "the same time")
    assert newest()[-1] == end
