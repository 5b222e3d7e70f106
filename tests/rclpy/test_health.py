"""Health on /diagnostics: a node reports dropped or missing messages, and recovers.

One node of each kind runs beside publishers of rclpy that send unusable messages.
"""

import array
import math

import pytest
from catenary_msgs.msg import ArmState
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import Image

from support.contract import BY_NAME
from support.program import MODEL

OK, WARN, ERROR = b"\0", b"\1", b"\2"
IMAGE, MASK, POSE = "/camera/camera/color/image_raw", "/dlo/mask", "/panda/current_pose"
NODES = ("camera", "late_camera", "keypoint_tracker", "policy_runner", "panda_bridge", "bayes_sim")


class Watched:
    """Newest health report of each node, and publishers at 20 Hz."""

    def __init__(self, session):
        self.session, self.ros, self.newest, self.timers = session, session.ros, {}, []
        self.ros.node.create_subscription(DiagnosticArray, "/diagnostics", self.hear, 100)

    def hear(self, message):
        self.newest |= {status.name.strip("/"): status for status in message.status}

    def publish(self, topic, message, profile=None):
        """Publishes a message 20 times a second, stamped with the present time unless its stamp is set."""
        publisher = self.ros.node.create_publisher(type(message), topic, profile or BY_NAME[topic].profile)
        is_stamped = hasattr(message, "header") and message.header.stamp.sec == 0

        def tick():
            if is_stamped:
                message.header.stamp = self.ros.node.get_clock().now().to_msg()
            publisher.publish(message)

        timer = self.ros.node.create_timer(0.05, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.timers.append((timer, publisher))

    def quiet(self):
        while self.timers:
            timer, publisher = self.timers.pop()
            self.ros.node.destroy_timer(timer)
            self.ros.node.destroy_publisher(publisher)

    def wait_for(self, node, levels, *words):
        """Values of the next report of a node that has one of these levels and all of these words."""
        self.newest.pop(node, None)

        def told():
            status = self.newest.get(node)
            return status and status.level in levels and all(word in status.message for word in words) and status

        status = None
        try:
            status = self.ros.wait_for(told, 25, f"{words} of {node}")
        except AssertionError as error:
            raise AssertionError(f"{error}; it says: {self.newest.get(node)}") from None
        return {value.key: value.value for value in status.values}


@pytest.fixture(scope="module")
def nodes(session_of_module):
    """One node of each kind, with inputs that only these tests publish, and a second camera under simulated time."""
    session = session_of_module
    session.node("camera")
    late = ("-r", "__node:=late_camera", "-r", f"{IMAGE[1:]}:=/late/image", "-p", "use_sim_time:=true")
    session.node("camera", *late, log="late_camera")
    session.node("keypoint_tracker", "-r", f"{MASK[1:]}:=/strange/mask")
    session.node("policy_runner", "-p", f"model_file:={MODEL}")
    session.node("panda_bridge", "-r", "current_pose:=/controller/pose")
    session.node("bayes_sim")
    session.meet(*NODES, within=20)
    return Watched(session)


@pytest.fixture
def watched(nodes):
    """The nodes, without publishers after the test."""
    yield nodes
    nodes.quiet()


def image(encoding, width=640, height=480, channels=3):
    data = array.array("B", bytes(width * height * channels))
    return Image(width=width, height=height, encoding=encoding, step=width * channels, data=data)


def image_of_a_bar():
    """An image with a blue bar, as long as a hanging object."""
    message = image("rgb8")
    for v in range(150, 330):
        start = v * message.step + 3 * 316
        message.data[start : start + 24] = array.array("B", (48, 92, 200) * 8)
    return message


def pose(frame="panda_link0", x=0.4):
    message = PoseStamped()
    message.header.frame_id, message.pose.position.x, message.pose.orientation.x, message.pose.orientation.w = frame, x, 1.0, 0.0
    return message


def test_a_camera_names_missing_and_dropped_images_and_recovers(watched):
    watched.wait_for("camera", [ERROR], "no images on " + IMAGE, "nobody publishes it")
    watched.publish(IMAGE, image("bayer_rggb8", channels=1))
    values = watched.wait_for("camera", [ERROR], "dropped", "expected rgb8", "bayer_rggb8")
    assert int(values["images_dropped_for_encoding"]) == int(values["images_dropped"]) > 0 and float(values["image_rate_hz"]) > 0
    assert "bayer_rggb8" in watched.session.text("camera.err")
    watched.quiet()
    watched.publish(IMAGE, image("rgb8"))
    watched.wait_for("camera", [WARN], "the object is in 0 % of the images")
    watched.quiet()
    watched.publish(IMAGE, image_of_a_bar())
    watched.wait_for("camera", [OK], "ok")


def test_an_image_with_an_old_stamp_is_doubtful(watched):
    old = image("rgb8")
    old.header.stamp.sec, old.header.stamp.nanosec = 1, 1
    watched.publish(IMAGE, old)
    values = watched.wait_for("camera", [WARN], "doubtful", "s old")
    assert int(values["images_doubtful_for_old_stamp"]) > 0 and int(values["images_received"]) > 0


def test_an_image_whose_size_differs_from_its_data_is_named(watched):
    short = image("rgb8")
    short.height = 481
    watched.publish(IMAGE, short)
    values = watched.wait_for("camera", [WARN, ERROR], "data")
    assert int(values["images_dropped_for_data"]) > 0


def test_simulated_time_without_a_clock_is_an_error(watched):
    watched.wait_for("late_camera", [ERROR], "use_sim_time", "/clock", "nobody publishes it")
    watched.publish("/clock", ClockMessage())
    values = watched.wait_for("late_camera", [OK, ERROR], "")
    assert float(values["resident_memory_mb"]) > 0
    watched.ros.wait_for(lambda: "/clock" not in watched.newest["late_camera"].message, 15, "a health without a complaint about /clock")
    watched.quiet()
    watched.wait_for("late_camera", [ERROR], "/clock has been silent")


WRONG_MASKS = [(image("mono8", 256, 200, 1), "256 x 200"), (image("rgb8", 256, 256), "rgb8")]
WRONG_POSES = [(pose("world"), ("panda_link0", "world")), (pose(x=math.nan), ("finite",))]


@pytest.mark.parametrize(("mask", "word"), WRONG_MASKS, ids=["size", "encoding"])
def test_a_tracker_names_the_fault_of_a_mask(watched, mask, word):
    watched.publish("/strange/mask", mask, BY_NAME[MASK].profile)
    watched.wait_for("keypoint_tracker", [ERROR], "dropped", word)


@pytest.mark.parametrize(("message", "words"), WRONG_POSES, ids=["frame", "nan"])
def test_a_bridge_names_the_fault_of_a_pose(watched, message, words):
    watched.publish("/controller/pose", message, BY_NAME[POSE].profile)
    watched.wait_for("panda_bridge", [ERROR], "poses", "dropped", *words)


def test_an_idle_graph_is_healthy_until_something_is_dropped(watched):
    for node in ("policy_runner", "bayes_sim"):
        watched.wait_for(node, [OK], "ok")
    watched.publish(POSE, pose("world"))
    for node in ("policy_runner", "bayes_sim"):
        watched.wait_for(node, [WARN], "poses", "panda_link0", "world")


def test_a_publisher_whose_profile_does_not_fit_is_named(watched):
    volatile = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE)
    watched.publish("/panda/arm_state", ArmState(), volatile)
    watched.wait_for("policy_runner", [WARN], "/panda/arm_state", "volatile")
