"""Runs a torque loop of libfranka 0.9.2 (panda-python) that does nothing: `torques.py ADDRESS CYCLES`."""

import sys

from panda_py import libfranka

cycles = 0


def callback(state, period):
    global cycles
    cycles += 1
    torques = libfranka.Torques([0.0] * 7)
    torques.motion_finished = cycles >= int(sys.argv[2])
    return torques


libfranka.Robot(sys.argv[1], libfranka.RealtimeConfig.kIgnore).control(callback)
