"""Checks with pylibfranka: libfranka 0.21.3, the vendor's client of a Franka Research 3."""

import time
from itertools import pairwise

import pylibfranka
from script import failure, main, server, smooth, wait_until


def connect(address):
    return pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore)


def torques(robot, cycles, torque=lambda n: [0.0] * 7, at=None):
    """Motion with torques; returns success rate and time in ms of each cycle."""
    control, states = robot.start_torque_control(), []
    for n in range(1, cycles + 1):
        state, _ = control.readOnce()
        states.append((state.control_command_success_rate, round(1e3 * state.time.to_sec())))
        if at:
            at(n)
        command = pylibfranka.Torques(torque(n))
        command.motion_finished = n == cycles
        control.writeOnce(command)
    return states


def assert_reflex(robot, motion, error):
    message = failure(motion)
    assert error in message, message
    robot.automatic_error_recovery()
    torques(robot, 10)


def check_01(address):
    connect(address).read_once()
    return "version 10 accepted"


def check_02(address):
    robot = connect(address)
    times = [robot.read_once().time.to_sec() for _ in range(100)]
    assert all(b > a for a, b in pairwise(times)), times
    assert abs(robot.read_once().O_ddP_O[2] + 9.81) < 1e-6
    return "100 states of 1377 bytes"


def check_03(address):
    robot = connect(address)
    robot.set_collision_behavior([20.0] * 7, [30.0] * 7, [20.0] * 6, [30.0] * 6)
    robot.set_joint_impedance([2500.0] * 7)
    robot.set_cartesian_impedance([1500.0] * 3 + [100.0] * 3)
    robot.set_load(0.5, [0, 0, 0.05], [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3])
    wait_until("the load", lambda: robot.read_once().m_load == 0.5)
    return "all setters accepted, load echoed"


def check_04(address):
    robot = connect(address)
    began = time.monotonic()
    states = torques(robot, 1000)
    ratio = 1 / (time.monotonic() - began)
    assert states[-1][0] == 1 and states[-1][1] - states[0][1] == 999, states[-1]
    return f"1000 cycles, success rate 1, {ratio:.0f} times real time"


def check_05(address):
    robot, cycles = connect(address), 2000
    control = robot.start_joint_position_control(pylibfranka.ControllerMode.JointImpedance)
    start = None
    for n in range(1, cycles + 1):
        state, _ = control.readOnce()
        start = start or list(state.q_d)
        command = pylibfranka.JointPositions([q + (0.3 * smooth(n / cycles) if i == 3 else 0) for i, q in enumerate(start)])
        command.motion_finished = n == cycles
        control.writeOnce(command)
    wait_until("the end", lambda: server("count motion ended: Success") == "1")
    return "joint positions: no reflex"


def check_06(address):
    robot = connect(address)
    step = lambda change: lambda n: [change if n % 4 == 1 and n < 21 else 0.0] + [0.0] * 6
    torques(robot, 25, step(0.999))
    assert_reflex(robot, lambda: torques(robot, 25, step(1.01)), "controller_torque_discontinuity")
    return "0.999 N m per cycle passes, 1.01 N m gives controller_torque_discontinuity"


def check_08(address):
    robot = connect(address)
    states = torques(robot, 400, at=lambda n: n == 150 and server("lose_commands 19"))
    rate = min(rate for rate, _ in states[150:])
    assert abs(rate - 0.81) < 0.015, rate
    lost = lambda: torques(robot, 400, at=lambda n: n == 150 and server("lose_commands 20"))
    assert_reflex(robot, lost, "communication_constraints_violation")
    return f"19 lost: success rate {rate:.2f}; 20 lost: communication_constraints_violation"


def check_10(address):
    robot = connect(address)
    message = failure(lambda: torques(robot, 10**6, at=lambda n: n == 100 and server("user_stop on")))
    assert "User Stop pressed" in message, message
    server("user_stop off")
    wait_until("idle", lambda: robot.read_once().robot_mode == pylibfranka.RobotMode.Idle)
    robot.automatic_error_recovery()
    torques(robot, 50)
    return "User Stop pressed!; motions again after release and recovery"


if __name__ == "__main__":
    main(globals())
