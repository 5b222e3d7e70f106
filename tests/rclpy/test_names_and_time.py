"""Namespaces, remaps, /clock and latched messages, with one node of ours at a time beside rclpy."""

import time

import pytest
from catenary_msgs.msg import EpisodeEvent, Keypoints
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import Image

from support.contract import BY_NAME
from support.masks import SIZE_PX, hanging_bar
from support.program import MODEL


def test_a_node_goes_by_its_new_names(session):
    session.node("keypoint_tracker", "-r", "__ns:=/lab", "-r", "__node:=tracker", "-r", "dlo/mask:=/elsewhere/mask")
    ros = session.meet("tracker")
    assert ("tracker", "/lab") in ros.node.get_node_names_and_namespaces()
    published = dict(ros.node.get_publisher_names_and_types_by_node("tracker", "/lab"))
    assert published["/lab/dlo/keypoints"] == ["catenary_msgs/msg/Keypoints"] and "/diagnostics" in published
    assert list(dict(ros.node.get_subscriber_names_and_types_by_node("tracker", "/lab"))) == ["/elsewhere/mask"]
    keypoints = ros.listen(Keypoints, "/lab/dlo/keypoints")
    masks = ros.node.create_publisher(Image, "/elsewhere/mask", BY_NAME["/dlo/mask"].profile)
    image = hanging_bar()

    def answered():
        masks.publish(image)
        return ros.holds_within(lambda: keypoints, 0.2)

    ros.wait_for(answered, 20, "keypoints of the mask")
    seen = keypoints[0]
    assert seen.header == image.header and (seen.image_width, seen.image_height) == (SIZE_PX, SIZE_PX)
    assert list(seen.dlo_u) == pytest.approx([128] * 4, abs=2)
    assert sorted(seen.dlo_v) == pytest.approx([60, 100, 140, 180], abs=4)
    assert seen.target_seen and (seen.target_u, seen.target_v) == pytest.approx((210, 190), abs=1.5)
    client = AsyncParameterClient(ros.node, "/lab/tracker")
    ros.wait_for(client.services_are_ready, 20, "the parameter services in the namespace")
    assert "fractions" in ros.result(client.list_parameters(), 20, "the list").result.names


@pytest.mark.parametrize("name", ["/clock"])
def test_rclpy_to_node_sets_the_time(session, name):
    session.node("camera", "-p", "use_sim_time:=true")
    ros = session.meet("camera")
    reports, now_s = [], [1000]
    ros.node.create_subscription(DiagnosticArray, "/diagnostics", lambda message: reports.append(message.header.stamp), 10)
    clocks = ros.node.create_publisher(ClockMessage, name, BY_NAME[name].profile)

    def tick():
        message = ClockMessage()
        message.clock.sec = now_s[0]
        clocks.publish(message)

    ros.node.create_timer(0.02, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
    told = lambda second: any(stamp.sec == second for stamp in reports)
    ros.wait_for(lambda: told(1000), 10, "a report at the time of /clock")
    now_s[0] = 2000
    ros.wait_for(lambda: told(2000), 10, "a report at its new time")
    now_s[0] = 1500
    ros.wait_for(lambda: told(1500), 10, "a report after a step back")
    client = AsyncParameterClient(ros.node, "camera")
    ros.wait_for(client.services_are_ready, 20, "the parameter services")
    ros.result(client.set_parameters([Parameter("use_sim_time", value=False)]), 10, "an answer")
    ros.wait_for(lambda: reports[-1].sec > 1_700_000_000, 10, "a report in wall time")
    assert "Inconsistent" not in session.text("camera.err")


@pytest.mark.parametrize("name", ["/clock"])
def test_node_to_rclpy_sets_the_time(session, name):
    options = (f"model_file:={MODEL}", "publish_clock:=true", "real_time_factor:=4.0", "fidelity:=fast")
    session.node("simulated_cell", *(part for option in options for part in ("-p", option)))
    ros = session.meet("simulated_cell")
    assert dict(ros.node.get_topic_names_and_types())[name] == ["rosgraph_msgs/msg/Clock"]
    # rclpy discovers a node's name before it knows which endpoints belong to the node.
    of_cell = lambda: [p for p in ros.node.get_publishers_info_by_topic(name) if p.node_name == "simulated_cell"]
    (publisher,) = ros.wait_for(of_cell, 10, "the publisher as the cell's own")
    assert publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    ros.node.set_parameters([Parameter("use_sim_time", value=True)])
    now_s = lambda: 1e-9 * ros.node.get_clock().now().nanoseconds
    ros.wait_for(lambda: now_s() > 0, 20, "the cell's time")
    first, began = now_s(), time.monotonic()
    ros.spin(2)
    passed, wall = now_s() - first, time.monotonic() - began
    assert passed > 1.5 * wall and first < 1000, f"{passed} s of the cell in {wall} s"


def test_our_late_joiner_gets_what_rclpy_latched(session):
    ros = session.meet()
    row = BY_NAME["/episode/event"]
    publisher = ros.node.create_publisher(row.kind, row.name, row.profile)
    for episode in range(20):
        publisher.publish(EpisodeEvent(episode=episode))
    ros.spin(1)
    bag = session.folder / "bag"
    recorder = session.node("recorder", "-p", f"output:={bag}", "-p", "topics:=[/episode/event]")
    ros.wait_for(lambda: publisher.get_subscription_count() and bag.exists(), 20, "the recorder")
    # Latched messages come with one of the next heartbeats of Fast DDS, up to 3 s later with its default settings.
    ros.spin(2.5)
    publisher.publish(EpisodeEvent(episode=20))
    ros.spin(1)
    session.stop(recorder)
    with AnyReader([bag]) as reader:
        episodes = [reader.deserialize(data, c.msgtype).episode for c, _, data in reader.messages()]
    # The history of /episode/event keeps 16 messages.
    assert episodes == list(range(4, 21)), "not the last sixteen and the new one"


def test_the_publishing_node_reports_a_profile_that_does_not_fit(session):
    session.node("camera")
    ros = session.meet("camera")
    ros.node.create_subscription(Image, "/dlo/mask", print, QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE))
    said = lambda: 'QoS mismatch Reliability topic="rt/dlo/mask"' in session.text("camera.err")
    ros.wait_for(said, 20, "a word about the profile")
