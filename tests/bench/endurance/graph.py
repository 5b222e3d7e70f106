"""Listener and driver of the graph in rclpy."""

import array
import time

from catenary_msgs.action import MoveToStart, RunEpisode
from rclpy.action import ActionClient

from support.contract import BY_NAME
from support.policy import policy_file

POLICY = array.array("B", policy_file())


class Heard:
    """Messages of a topic: sequence number of the sender, times of sending and taking (ns), and bytes (12 without `keep`)."""

    def __init__(self, ros, name, keep=True, depth=2000):
        row = BY_NAME[name]
        self.kind, self.messages = row.kind, []

        def came(data, info):
            kept = data if keep else data[:12]
            self.messages.append((info["publication_sequence_number"], info["source_timestamp"], time.time_ns(), kept))

        self.subscription = ros.node.create_subscription(row.kind, name, came, row.profile_of_depth(depth), raw=True)

    def since(self, taken_ns):
        """Messages that were taken after a time, the newest last."""
        first = len(self.messages)
        while first and self.messages[first - 1][2] > taken_ns:
            first -= 1
        return self.messages[first:]

    def sent_since(self, sent_ns):
        """Tells whether the newest message was sent after a time."""
        return bool(self.messages) and self.messages[-1][1] > sent_ns


class Driver:
    """Moves the arm to the start and runs episodes, as a script of a lab does."""

    def __init__(self, ros):
        self.ros = ros
        self.mover = ActionClient(ros.node, MoveToStart, "/panda/move_to_start")
        self.runner = ActionClient(ros.node, RunEpisode, "/policy_runner/run_episode")

    def send(self, client, goal, seconds=10):
        """Sends a goal; returns the handle of the accepted goal."""
        self.ros.wait_for(client.server_is_ready, seconds, "the server of an action")
        handle = self.ros.result(client.send_goal_async(goal), seconds, "an answer to a goal")
        assert handle.accepted, "the goal was rejected"
        return handle

    def to_start(self, seconds=30):
        handle = self.send(self.mover, MoveToStart.Goal(settle_time=0.3))
        result = self.ros.result(handle.get_result_async(), seconds, "the end of the move to the start").result
        assert result.success, f"move to the start: {result.message}"
        self.ros.still_object()

    def begin(self, seed, steps=0):
        goal = RunEpisode.Goal(policy=POLICY, policy_name="endurance", seed=seed, run_all_steps=True, max_steps=steps)
        return self.send(self.runner, goal)

    def episode(self, seed, steps=0):
        """Runs a whole episode from the start pose; returns its result."""
        self.to_start()
        result = self.ros.result(self.begin(seed, steps).get_result_async(), 40, "the end of the episode").result
        assert result.success, f"episode: {result.message}"
        return result
