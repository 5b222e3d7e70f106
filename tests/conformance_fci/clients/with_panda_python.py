"""Checks with panda-python: libfranka 0.9.2, the vendor's client of a Panda."""

import math
import os
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise

from panda_py import libfranka
from script import failure, farthest, main, server, smooth, wait_until

UNFILTERED = 1000.0
IDENTITY = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
JOINT_IMPEDANCE, CARTESIAN_IMPEDANCE = libfranka.ControllerMode.kJointImpedance, libfranka.ControllerMode.kCartesianImpedance


def connect(address):
    return libfranka.Robot(address, libfranka.RealtimeConfig.kIgnore)


def wait_for_mode(robot, mode):
    """First state with a mode."""
    states = []

    def has_come():
        states.append(robot.read_once())
        return states[-1].robot_mode == mode

    wait_until(mode, has_come)
    return states[-1]


def assert_reflex(robot, motion, error):
    """Runs a motion that must end in a reflex with this error. Another motion is refused until the recovery."""
    message = failure(motion)
    assert error in message, f"expected {error}, got {message}"
    state = wait_for_mode(robot, libfranka.RobotMode.kReflex)
    assert error in str(state.last_motion_errors), state.last_motion_errors
    assert "Reflex" in failure(lambda: torques(robot, 10))
    recover(robot)


def recover(robot):
    robot.automatic_error_recovery()
    wait_for_mode(robot, libfranka.RobotMode.kIdle)


def torques(robot, cycles, torque=lambda n: [0.0] * 7, at=None, states=None):
    """Motion with torques, without filter and limit. `at` is called with the number of each cycle."""
    n = 0

    def step(state, duration):
        nonlocal n
        n += 1
        if states is not None:
            states.append((state.control_command_success_rate, state.time.to_msec()))
        if at:
            at(n)
        command = libfranka.Torques(torque(n))
        command.motion_finished = n >= cycles
        return command

    robot.control(step, False, UNFILTERED)


def follow(control, kind, cycles, value, controller=JOINT_IMPEDANCE, limit=True, at=None):
    """Motion of a generator: `control` is a method of the robot, `value(n, state)` the command of a cycle."""
    n = 0

    def step(state, duration):
        nonlocal n
        n += 1
        if at:
            at(n, state)
        command = kind(value(n, state))
        command.motion_finished = n >= cycles
        return command

    control(step, controller, limit, UNFILTERED)


def check_01(address):
    assert connect(address).server_version() == 5
    return "version 5 accepted"


def check_02(address):
    robot, times = connect(address), []

    def read(state):
        times.append(state.time.to_msec())
        return len(times) < 100

    robot.read(read)
    assert all(b > a for a, b in pairwise(times)), times
    return f"100 states in {times[-1] - times[0]} ms of the robot's clock"


def check_03(address):
    robot = connect(address)
    robot.set_collision_behavior([20.0] * 7, [30.0] * 7, [20.0] * 7, [30.0] * 7, [20.0] * 6, [30.0] * 6, [20.0] * 6, [30.0] * 6)
    robot.set_joint_impedance([2500.0] * 7)
    robot.set_cartesian_impedance([1500.0] * 3 + [100.0] * 3)
    robot.set_guiding_mode([True] * 6, True)
    before = robot.read_once()
    frame = IDENTITY[:14] + [0.05, 1.0]
    robot.set_k(frame)
    robot.set_ee(frame)
    robot.set_load(0.5, [0, 0, 0.05], [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3])
    wait_until("the load", lambda: robot.read_once().m_load == 0.5)
    state = robot.read_once()
    assert list(state.EE_T_K) == frame and list(state.F_x_Cload) == [0, 0, 0.05]
    assert abs(state.F_T_EE[14] - before.F_T_EE[14] - 0.05) < 1e-9
    return "all setters accepted and echoed"


def check_04(address):
    robot, states = connect(address), []
    began = time.monotonic()
    torques(robot, 1000, states=states)
    ratio = 1 / (time.monotonic() - began)
    assert len(states) == 1000 and states[-1][0] == 1.0, states[-1]
    assert states[-1][1] - states[0][1] == 999, "no cycle lost"
    return f"1000 cycles, success rate 1, {ratio:.0f} times real time"


def check_05_limited(address):
    robot, cycles = connect(address), 2000
    start = robot.read_once()
    follow(
        robot.control_joint_position,
        libfranka.JointPositions,
        cycles,
        lambda n, _: [q + (0.3 * smooth(n / cycles) if i == 3 else 0) for i, q in enumerate(start.q_d)],
    )
    sine = lambda n: math.sin(2 * math.pi * n / cycles)
    follow(robot.control_joint_velocity, libfranka.JointVelocities, cycles, lambda n, _: [0.2 * sine(n)] + [0.0] * 6)
    pose = list(robot.read_once().O_T_EE_c)
    lifted = lambda n, _: pose[:14] + [pose[14] + 0.05 * smooth(n / cycles), 1.0]
    follow(robot.control_cartesian_pose, libfranka.CartesianPose, cycles, lifted, CARTESIAN_IMPEDANCE)
    twist = lambda n, _: [0, 0.05 * sine(n), 0, 0, 0, 0]
    follow(robot.control_cartesian_velocity, libfranka.CartesianVelocities, cycles, twist, CARTESIAN_IMPEDANCE)
    wait_until("four ends", lambda: server("count motion ended: Success") == "4")
    return "four generators with rate limits: no reflex"


def check_05_exceeded(address):
    robot = connect(address)
    speeds = lambda change: (
        lambda: follow(robot.control_joint_velocity, libfranka.JointVelocities, 2000, lambda n, _: [change * n] + [0.0] * 6, limit=False)
    )

    def positions(first, then):
        start = list(robot.read_once().q_d)
        value = lambda n, _: [start[0] + (first if n < 10 else then), *start[1:]]
        return lambda: follow(robot.control_joint_position, libfranka.JointPositions, 100, value, limit=False)

    def poses(first, then):
        start = list(robot.read_once().O_T_EE_c)
        value = lambda n, _: start[:12] + [start[12] + (first if n < 10 else then), *start[13:]]
        return lambda: follow(robot.control_cartesian_pose, libfranka.CartesianPose, 100, value, limit=False)

    twists = lambda: follow(
        robot.control_cartesian_velocity, libfranka.CartesianVelocities, 100, lambda n, _: [0.05 * n] + [0.0] * 5, limit=False
    )
    # Limits: 2.175 rad/s, 15 rad/s2 at joint 1; 13 m/s2.
    motions = {
        "joint_motion_generator_velocity_limits_violation": speeds(0.007),
        "joint_motion_generator_acceleration_discontinuity": speeds(0.016),
        "joint_position_motion_generator_start_pose_invalid": lambda: positions(0.1, 0.1)(),
        "joint_motion_generator_velocity_discontinuity": lambda: positions(0.0, 0.001)(),
        "cartesian_position_motion_generator_start_pose_invalid": lambda: poses(0.05, 0.05)(),
        "cartesian_motion_generator_velocity_discontinuity": lambda: poses(0.0, 0.001)(),
        "cartesian_motion_generator_acceleration_discontinuity": twists,
    }
    for error, motion in motions.items():
        assert_reflex(robot, motion, error)
    torques(robot, 10)
    return f"{len(motions)} limits exceeded, each with its error; Move refused until recovery"


def check_06(address):
    robot = connect(address)
    # Up and down, so that the arm stays where it is.
    step = lambda change: lambda n: [change if n % 4 == 1 and n < 21 else 0.0] + [0.0] * 6
    torques(robot, 25, step(1.0))
    assert_reflex(robot, lambda: torques(robot, 25, step(1.01)), "controller_torque_discontinuity")
    return "1 N m per cycle passes, 1.01 N m gives controller_torque_discontinuity"


def thresholds(robot, lower, upper):
    lower, upper = [lower] * 6, [upper] * 6
    robot.set_collision_behavior(*[[100.0] * 7] * 4, lower, upper, lower, upper)


def hold(robot, cycles, at=None, states=None):
    """Holds the pose with the Cartesian impedance."""
    pose = list(robot.read_once().O_T_EE_c)

    def each(n, state):
        if states is not None:
            states.append((list(state.O_T_EE), list(state.cartesian_contact)))
        if at:
            at(n)

    follow(robot.control_cartesian_pose, libfranka.CartesianPose, cycles, lambda *_: pose, CARTESIAN_IMPEDANCE, False, each)


def check_07(address):
    robot, states = connect(address), []
    push = lambda newtons: server(f"push {newtons} 0 0 0 0 0")
    thresholds(robot, 10.0, 20.0)
    message = failure(lambda: hold(robot, 3000, lambda n: n == 100 and push(25), states))
    assert "cartesian_reflex" in message, message
    assert any(any(contact) for _, contact in states), "a contact comes before the collision"
    push(0)
    recover(robot)
    thresholds(robot, 100.0, 100.0)
    hold(robot, 3000, lambda n: push(25) if n == 100 else n == 1500 and push(0))
    return "25 N: contact, then cartesian_reflex; with thresholds of 100 N no reflex"


def check_08(address):
    robot, states = connect(address), []
    lose = lambda count: lambda n: n == 150 and server(f"lose_commands {count}")
    torques(robot, 400, at=lose(19), states=states)
    rate = min(rate for rate, _ in states[150:])
    assert abs(rate - 0.81) < 0.015, rate
    assert_reflex(robot, lambda: torques(robot, 400, at=lose(20)), "communication_constraints_violation")
    return f"19 lost: success rate {rate:.2f}; 20 lost: communication_constraints_violation"


def endless(robot):
    """Motion that another thread ends; returns the thread and the list that gets its message."""
    messages = []
    thread = threading.Thread(target=lambda: messages.append(failure(lambda: torques(robot, 10**9))))
    thread.start()
    wait_until("the motion", lambda: server("count motion started") != "0")
    return thread, messages


def check_09(address):
    robot = connect(address)
    thread, messages = endless(robot)
    robot.stop()
    thread.join(10)
    assert messages and "preempted" in messages[0], messages
    wait_for_mode(robot, libfranka.RobotMode.kIdle)
    robot.stop()
    robot.stop()
    return "stop in a motion: preempted; stop without a motion twice: accepted"


def check_10(address):
    robot = connect(address)
    thread, messages = endless(robot)
    server("user_stop on")
    thread.join(10)
    assert messages and "User Stop pressed" in messages[0], messages
    assert not str(wait_for_mode(robot, libfranka.RobotMode.kUserStopped).current_errors).strip("[]")
    assert "User stopped" in failure(lambda: torques(robot, 10))
    server("user_stop off")
    wait_for_mode(robot, libfranka.RobotMode.kIdle)
    recover(robot)
    torques(robot, 50)
    return "User Stop pressed!; motions again after release and recovery"


def check_11(address):
    robot = connect(address)
    moving = lambda: torques(robot, 300, lambda n: [min(0.05 * n, 5.0)] + [0.0] * 6)
    assert_reflex(robot, moving, "joint_motion_generator_velocity_discontinuity")
    return "finished at speed: joint_motion_generator_velocity_discontinuity"


def check_12(address):
    robot = connect(address)
    for fault in ("lose_states 5", "repeat_states 5", "swap_states"):
        states = []
        torques(robot, 400, at=lambda n, fault=fault: n == 150 and server(fault), states=states)
        assert all(b > a for (_, a), (_, b) in pairwise(states)), f"{fault}: the client went back in time"
        assert min(rate for rate, _ in states[150:]) >= 0.93, fault
    return "motions go on after lost, repeated and swapped states"


def check_12_lab(address):
    robot, states = connect(address), []
    torques(robot, 5000, states=states)
    rate = min(rate for rate, _ in states[150:])
    assert 0.8 < rate < 1, rate
    return f"preset lab, 5000 cycles: least success rate {rate:.2f}"


def dies(address):
    """Client that is killed in a motion."""
    torques(connect(address), 1000, at=lambda n: n == 100 and os.kill(os.getpid(), signal.SIGKILL))


def check_13(address):
    done = subprocess.run([sys.executable, __file__, "dies", address], check=False, timeout=20)
    assert done.returncode == -signal.SIGKILL
    robot = connect(address)
    state = wait_for_mode(robot, libfranka.RobotMode.kReflex)
    assert "communication_constraints_violation" in str(state.last_motion_errors), state.last_motion_errors
    assert "Reflex" in failure(lambda: torques(robot, 10))
    recover(robot)
    torques(robot, 50)
    return "killed in a motion: reflex, the next client recovers and moves the arm"


def check_14_library(address):
    robot = connect(address)
    model, state = robot.load_model(), robot.read_once()
    pose = farthest(model.pose(libfranka.Frame.kEndEffector, state), state.O_T_EE)
    torque = farthest(model.gravity(state), state.tau_J)
    assert pose < 1e-9, pose
    # A resting Panda differed by up to 0.85 N m from its model.
    assert torque < 0.85, torque
    return f"pose within {pose:.0e} m, torque at rest within {torque:.2f} N m"


def check_15(address):
    robot, stiffness = connect(address), 500.0
    thresholds(robot, 100.0, 100.0)
    robot.set_cartesian_impedance([stiffness] * 3 + [50.0] * 3)
    hold(robot, 1000)
    before, states = robot.read_once().O_T_EE[14], []
    hold(robot, 3000, lambda n: n == 1 and server(f"push 0 0 {-0.5 * 9.81} 0 0 0"), states)
    sag, expected = before - states[-1][0][14], 0.5 * 9.81 / stiffness
    # Stiction of the joints carries a part of the weight.
    assert abs(sag / expected - 1) < 0.4, (sag, expected)
    return f"0.5 kg at {stiffness:.0f} N/m: {1e3 * sag:.1f} mm, weight / stiffness {1e3 * expected:.1f} mm"


def check_16(address):
    robot = connect(address)
    for _ in range(20):
        torques(robot, 20)
    wait_until("20 ends", lambda: server("count motion ended") == "20")
    assert server("count motion started") == "20"
    return "20 motions, 20 ends"


def check_17(address):
    robot = connect(address)
    message = failure(robot.load_model)
    assert "Server reports error" in message, message
    robot.read_once()
    return "without a library: the client is told so, and stays connected"


def check_17_library(address):
    model = connect(address).load_model()
    assert model is not None
    return "30 functions found"


if __name__ == "__main__":
    main(globals())
