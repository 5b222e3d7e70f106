"""A foreign simulator pool that answers at once with tracks of zeros.

Usage: other_pool.py DOMAIN SERVICE VERSION
"""

import sys

import rclpy
from catenary_msgs.msg import Track
from catenary_msgs.srv import Simulate


def simulate(request, response):
    frames = len(request.frame_times)
    zeros = Track(time=request.frame_times, dlo=[0.0] * 8 * frames, target=[0.0] * 2 * frames, eef=[0.0] * 3 * frames)
    zeros.action, zeros.end = [0.0] * 2 * frames, "complete"
    response.tracks = [zeros] * (len(request.theta) // 2)
    response.success, response.version, response.fingerprint = True, VERSION, 1
    return response


DOMAIN, SERVICE, VERSION = sys.argv[1:]
rclpy.init(domain_id=int(DOMAIN))
node = rclpy.create_node("other_pool")
node.create_service(Simulate, SERVICE, simulate)
rclpy.spin(node)
