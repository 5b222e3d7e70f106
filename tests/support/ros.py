"""A node of rclpy beside the processes of a test, and goals that it sends.

Without rclpy, or without catenary_msgs built for Python, tests that need them are skipped.
"""

import importlib.util
import sys
import time

import pytest

from .waiting import wait_for

PYTHON = f"Python {sys.version_info.major}.{sys.version_info.minor}"


def is_missing(name):
    """Tells whether a package is not installed. The folder tests/rclpy can be imported, but has no origin."""
    spec = importlib.util.find_spec(name)
    return spec is None or spec.origin is None


MISSING = [name for name in ("rclpy", "rcl_interfaces", "catenary_msgs") if is_missing(name)]
NO_RCLPY = f"{PYTHON} has no {', '.join(MISSING)} here: see tests/environment"
if not MISSING:
    import rclpy
    from action_msgs.msg import GoalStatus
    from rcl_interfaces.msg import Log
    from rclpy.action import ActionClient
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from std_srvs.srv import Trigger


# Services that every node offers, ours and those of rclpy.
SERVICES = ("describe_parameters", "get_parameter_types", "get_parameters", "get_type_description", "list_parameters", "set_parameters")


def sees(node, nodes):
    """Tells whether a node of rclpy sees all of `nodes`, each with the services that every node offers.

    The names alone say little: they come in one message of each participant, and what Fast DDS may miss are endpoints.
    """
    seen = dict(node.get_node_names_and_namespaces())
    try:
        offered = {name: {service for service, _ in node.get_service_names_and_types_by_node(name, seen[name])} for name in nodes}
    except (KeyError, RuntimeError):
        return False  # One of them is not known yet, or has left meanwhile.
    return all(f"{seen[name].rstrip('/')}/{name}/{service}" in offered[name] for name in nodes for service in SERVICES)


class Ros:
    """A node of rclpy that spins while a test waits."""

    def __init__(self, domain, name="stranger"):
        if MISSING:
            pytest.skip(NO_RCLPY)
        self.context = rclpy.Context()
        self.context.init(domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def wait_for(self, condition, seconds, what):
        """Returns the first true value of `condition`, spinning meanwhile; fails with `what` after `seconds`."""
        return wait_for(condition, seconds, what, pause=lambda: self.executor.spin_once(timeout_sec=0.05))

    def holds_within(self, condition, seconds):
        """Tells whether `condition` becomes true within `seconds`."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if condition():
                return True
            self.executor.spin_once(timeout_sec=0.05)
        return False

    def spin(self, seconds):
        """Takes messages for `seconds`."""
        self.holds_within(lambda: False, seconds)

    def result(self, future, seconds, what):
        """Returns the result of a future; fails with `what` after `seconds`."""
        self.wait_for(future.done, seconds, what)
        return future.result()

    def listen(self, kind, topic, depth=100):
        """Subscribes with best effort; returns the list that messages are appended to."""
        messages = []
        profile = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.node.create_subscription(kind, topic, messages.append, profile)
        return messages

    def listen_log(self):
        """Subscribes to /rosout; returns the list that log lines are appended to, latched ones included."""
        lines = []
        profile = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(Log, "/rosout", lines.append, profile)
        return lines

    def call(self, kind, name, request, seconds=30):
        """Returns the answer of a service."""
        client = self.node.create_client(kind, name)
        try:
            self.wait_for(client.service_is_ready, seconds, f"service {name}")
            return self.result(client.call_async(request), seconds, f"an answer of {name}")
        finally:
            self.node.destroy_client(client)

    def set_parameter(self, node, name, value):
        """Sets a parameter of a node."""
        client = AsyncParameterClient(self.node, node)
        self.wait_for(client.services_are_ready, 20, f"the parameters of {node}")
        answer = self.result(client.set_parameters([Parameter(name, value=value)]), 20, "an answer")
        assert answer.results[0].successful, answer.results[0].reason

    def still_object(self):
        """Stills the object of a simulated cell, so that an episode begins at once."""
        # The cell refuses while the hand moves.
        stilled = lambda: self.call(Trigger, "/simulated_cell/still_object", Trigger.Request()).success
        self.wait_for(stilled, 10, "a hand at rest")

    def close(self):
        if not self.context.ok():
            return
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


class Goal:
    """A goal that a node of rclpy has sent: its acceptance, feedback and result."""

    def __init__(self, ros, kind, name, goal, seconds=30):
        self.ros, self.name, self.seconds, self.feedback = ros, name, seconds, []
        self.client = ActionClient(ros.node, kind, name)
        ros.wait_for(self.client.server_is_ready, 20, f"the server of {name}")
        sent = self.client.send_goal_async(goal, feedback_callback=lambda message: self.feedback.append(message.feedback))
        self.handle = ros.result(sent, 20, f"an answer of {name}")
        self.answer = self.handle.get_result_async() if self.handle.accepted else None

    def end(self):
        """Returns status and result, whatever the status."""
        assert self.handle.accepted, f"{self.name} rejected the goal"
        return self.ros.result(self.answer, self.seconds, f"the end of {self.name}")

    def result(self, status=None):
        """Returns the result of a goal that has to end with a status; by default it has to succeed."""
        answer = self.end()
        assert answer.status == (GoalStatus.STATUS_SUCCEEDED if status is None else status), answer.result
        return answer.result

    @property
    def steps(self):
        """Feedback of work, without that of an episode that waits for a still object."""
        return [feedback for feedback in self.feedback if not getattr(feedback, "waiting", False)]

    def wait_feedback(self):
        """Waits for the first feedback of work."""
        self.ros.wait_for(lambda: self.steps, self.seconds, f"feedback of {self.name}")

    def ends_within(self, seconds):
        """Tells whether the goal ends within `seconds`."""
        return self.ros.holds_within(self.answer.done, seconds)

    def cancel(self):
        """Cancels the goal; returns the server's answer."""
        return self.ros.result(self.handle.cancel_goal_async(), 20, f"an answer of {self.name} to the cancel")
