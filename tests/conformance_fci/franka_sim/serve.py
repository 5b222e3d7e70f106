"""Serves franka-sim's robot at an address: serve.py ADDRESS. It breaks a motion off that breaks the limits of a Franka Research 3."""

import logging
import sys

from franka_sim.franka_sim_server import FrankaSimServer

logging.basicConfig(level=logging.INFO)
FrankaSimServer(host=sys.argv[1], port=1337, enable_gripper=False, physics="mujoco", enforce_motion_limits=True).start()
