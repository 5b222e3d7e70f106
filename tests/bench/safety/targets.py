"""Publishes targets that move along x, until it ends by SIGTERM: `targets.py DOMAIN X Z SPEED [KIND]`.

It stands for a policy runner: it says that an episode has begun, and streams 50 targets a second from the hand's place on.
"""

import signal
import sys
import time

import rclpy
from catenary_msgs.msg import EpisodeEvent
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

PERIOD_S = 0.02


def main():
    domain, x_m, z_m, speed_m_s = int(sys.argv[1]), *map(float, sys.argv[2:5])
    kind = sys.argv[5] if len(sys.argv) > 5 else "good"
    context = rclpy.Context()
    context.init(domain_id=domain)
    node = rclpy.create_node(f"targets_{kind}", context=context)
    targets = node.create_publisher(PoseStamped, "/panda/target_pose", QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE))
    latched = QoSProfile(depth=16, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    events = node.create_publisher(EpisodeEvent, "/episode/event", latched)
    while not targets.get_subscription_count() or not events.get_subscription_count():
        time.sleep(0.02)
    time.sleep(0.3)
    events.publish(EpisodeEvent(episode=1, event=EpisodeEvent.STARTED, step_period=PERIOD_S, policy="bench"))
    print("ready", flush=True)
    # The bench enables the arm, and then says when to go.
    sys.stdin.readline()
    start = time.monotonic()
    ends = []
    signal.signal(signal.SIGTERM, lambda *_: ends.append(True))
    while not ends:
        elapsed_s = time.monotonic() - start
        target = PoseStamped()
        target.header.frame_id = "panda_link0"
        target.header.stamp.sec, target.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
        target.pose.position.x, target.pose.position.z = x_m + speed_m_s * elapsed_s, z_m
        target.pose.orientation.x, target.pose.orientation.w = 1.0, 0.0
        if kind == "nan" and elapsed_s > 0.6:
            target.pose.position.x = float("nan")
        targets.publish(target)
        time.sleep(max(0.0, start + PERIOD_S * (1 + elapsed_s // PERIOD_S) - time.monotonic()))
    node.destroy_node()
    context.try_shutdown()


if __name__ == "__main__":
    main()
