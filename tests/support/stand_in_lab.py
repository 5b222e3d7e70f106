"""A lab beside the relay, in rclpy: a controller with the interface of crisp_controllers, and keypoints of a hanging object.

Usage: stand_in_lab.py DOMAIN
"""

import contextlib
import math
import pathlib
import sys

import rclpy
from catenary_msgs.msg import Keypoints
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from sensor_msgs.msg import JointState

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from support.contract import BASE, BY_NAME, OPTICAL

PERIOD_S = 0.005
# Lag of the controlled arm, about as in the simulated cell.
TIME_CONSTANT_S = 0.15
IMAGE_PX = 256


class Lab:
    """Controller and camera of the lab; the arm follows targets with a first-order lag."""

    def __init__(self, context):
        self.node = node = rclpy.create_node("cartesian_impedance_controller", context=context)
        for axis in ("pos_x", "pos_y", "pos_z", "rot_x", "rot_y", "rot_z"):
            node.declare_parameter(f"task.k_{axis}", 500.0)
            node.declare_parameter(f"task.d_{axis}", -1.0)
        for axis in "xyz":
            node.declare_parameter(f"task.error_clip.{axis}", 0.1)
        node.declare_parameter("limit_error", False)
        self.at, self.to = [0.45, 0.40], [0.45, 0.40]
        node.create_subscription(PoseStamped, "/target_pose", self.follow, 1)
        self.pose = node.create_publisher(PoseStamped, "/current_pose", 1)
        self.joints = node.create_publisher(JointState, "/joint_states", 1)
        row = BY_NAME["/dlo/keypoints"]
        self.keypoints = node.create_publisher(row.kind, row.name, row.profile)
        node.create_timer(PERIOD_S, self.move)
        node.create_timer(1 / 60, self.look)

    def follow(self, target):
        self.to = [target.pose.position.x, target.pose.position.z]

    def stamped(self, message, frame):
        message.header.stamp, message.header.frame_id = self.node.get_clock().now().to_msg(), frame
        return message

    def move(self):
        share = 1 - math.exp(-PERIOD_S / TIME_CONSTANT_S)
        self.at = [a + share * (t - a) for a, t in zip(self.at, self.to)]
        message = self.stamped(PoseStamped(), BASE)
        message.pose.position.x, message.pose.position.z = self.at
        message.pose.orientation.x, message.pose.orientation.w = 1.0, 0.0
        self.pose.publish(message)
        joints = JointState(name=[f"panda_joint{i}" for i in range(1, 8)], position=[0.0, 0.1, 0.0, -2.0, 0.0, 2.0, 0.8])
        self.joints.publish(self.stamped(joints, BASE))

    def look(self):
        u, v = 300 * (self.at[0] - 0.1), 300 * (0.7 - self.at[1])
        seen = Keypoints(image_width=IMAGE_PX, image_height=IMAGE_PX, dlo_u=[u] * 4, dlo_v=[v + 15 * i for i in range(4)])
        seen.dlo_scores, seen.target_seen, seen.target_u, seen.target_v, seen.target_score = [1.0] * 4, True, 200.0, 200.0, 1.0
        self.keypoints.publish(self.stamped(seen, OPTICAL))


def main():
    context = rclpy.Context()
    context.init(domain_id=int(sys.argv[1]))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(Lab(context).node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
