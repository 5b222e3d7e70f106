"""Checks with franky: libfranka 0.21.2 under a library of motions, for a Franka Research 3."""

import franky
from script import failure, farthest, main, server, wait_until


def connect(address):
    robot = franky.Robot(address, realtime_config=franky.RealtimeConfig.Ignore)
    robot.relative_dynamics_factor = 0.05
    return robot


def check_01(address):
    connect(address)
    return "version 10 accepted"


def check_05(address):
    robot = connect(address)
    start = list(robot.current_joint_state.position)
    goal = [q + (0.2 if i == 3 else 0) for i, q in enumerate(start)]
    robot.move(franky.JointMotion(goal))
    reached = farthest(list(robot.current_joint_state.position), goal)
    assert reached < 0.01, reached
    robot.move(franky.CartesianMotion(franky.Affine([0, 0, 0.03]), franky.ReferenceType.Relative))
    wait_until("two ends", lambda: server("count motion ended: Success") == "2")
    return f"joint motion within {reached:.4f} rad, Cartesian motion: no reflex"


def check_10(address):
    robot = connect(address)
    goal = [q + 0.5 for q in robot.current_joint_state.position]
    robot.move(franky.JointMotion(goal), asynchronous=True)
    wait_until("the motion", lambda: server("count motion started") != "0")
    server("user_stop on")
    message = failure(robot.join_motion)
    assert "User Stop pressed" in message, message
    server("user_stop off")
    wait_until("idle", lambda: server("count mode: Idle") == "1")
    robot.recover_from_errors()
    robot.move(franky.JointMotion(list(robot.current_joint_state.position)))
    return "User Stop pressed!; motions again after release and recovery"


if __name__ == "__main__":
    main(globals())
