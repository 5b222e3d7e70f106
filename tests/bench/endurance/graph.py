"""The graph as a stranger in rclpy hears and drives it."""

import array
import time

import numpy
from catenary_msgs.action import MoveToStart, RunEpisode
from contract import BY_NAME
from policy import policy_file
from rclpy.action import ActionClient

POLICY = array.array("B", policy_file())


class Heard:
    """A topic: for each message its number in the sender's count, the times of sending and taking in ns, and its bytes."""

    def __init__(self, ros, name, keep=True, depth=2000):
        row = BY_NAME[name]
        self.kind, self.messages = row.kind, []

        def came(data, info):
            self.messages.append((info["publication_sequence_number"], info["source_timestamp"], time.time_ns(), data if keep else data[:12]))

        self.subscription = ros.node.create_subscription(row.kind, name, came, row.profile_of_depth(depth), raw=True)

    def since(self, taken_ns):
        """Messages that were taken after a time, the newest last."""
        first = len(self.messages)
        while first and self.messages[first - 1][2] > taken_ns:
            first -= 1
        return self.messages[first:]

    def sent_since(self, sent_ns):
        """The newest message, if it was sent after a time."""
        return bool(self.messages) and self.messages[-1][1] > sent_ns


def stamp_of(data):
    """The stamp in ns that a message with a header begins with, after the CDR header."""
    sec, nanosec = numpy.frombuffer(data[4:12], numpy.uint32)
    return int(sec) * 10**9 + int(nanosec)


class Driver:
    """Moves to the start and runs episodes, as a lab's own script would."""

    def __init__(self, ros):
        self.ros = ros
        self.mover = ActionClient(ros.node, MoveToStart, "/panda/move_to_start")
        self.runner = ActionClient(ros.node, RunEpisode, "/policy_runner/run_episode")

    def send(self, client, goal, seconds=10):
        """An accepted goal."""
        self.ros.wait_for(client.server_is_ready, seconds, "the server of an action")
        handle = self.ros.result(client.send_goal_async(goal), seconds, "an answer to a goal")
        assert handle.accepted, "the goal was rejected"
        return handle

    def to_start(self, seconds=30):
        handle = self.send(self.mover, MoveToStart.Goal(settle_time=0.3))
        result = self.ros.result(handle.get_result_async(), seconds, "the end of the move to the start").result
        assert result.success, f"move to the start: {result.message}"

    def begin(self, seed, steps=0):
        goal = RunEpisode.Goal(policy=POLICY, policy_name="endurance", seed=seed, run_all_steps=True, max_steps=steps)
        return self.send(self.runner, goal)

    def episode(self, seed, steps=0):
        """The result of a whole episode from the start pose."""
        self.to_start()
        result = self.ros.result(self.begin(seed, steps).get_result_async(), 40, "the end of the episode").result
        assert result.success, f"episode: {result.message}"
        return result
