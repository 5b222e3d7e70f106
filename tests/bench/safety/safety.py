"""Distance and time to standstill of the emulated arm after faults at three speeds, and the force of a blocked arm.

    source .venv/ros.env; .venv/bin/python tests/bench/safety/safety.py [--speeds 0.05,0.1,0.25] [--repeats 3]

The bridge drives the emulator by FCI on the clock, with targets 50 times a second. Each fault comes after 0.6 s of motion. Positions are
the emulator's own, which no client of FCI sees. Run it on an idle machine.
"""

import argparse
import contextlib
import math
import os
import pathlib
import signal
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

from catenary_msgs.action import MoveToStart  # noqa: E402
from catenary_msgs.msg import ArmState  # noqa: E402
from geometry_msgs.msg import PoseStamped, WrenchStamped  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from support.ros import Goal  # noqa: E402
from support.session import given, session_in  # noqa: E402

START_M = (0.32, 0.42)
# Box of the task in the shipped model, greatest x.
BOX_M = 0.6
# Time of motion before a fault, and longest time watched after it.
MOTION_S, WATCH_S = 0.6, 5.0
# Speed that counts as standstill, and how long it must last.
STILL_M_S, STILL_S = 0.004, 0.15
# Push from below, beyond the threshold of 40 N. Sideways, joint 6 would be out of the range of its torque sensor first.
PUSH_N = 60.0
# Limits that the arm must keep: distance out of the box, and the collision threshold of the bridge's defaults.
MOST_OUT_MM, MOST_FORCE_N = 10.0, 40.0
# Age of a true pose at which this process is too late to measure anything. On an idle machine it is some milliseconds.
MOST_LATE_S = 0.05
# Stiffness of the wall that blocks the arm.
WALL_N_M = 5000.0
FAULTS = (
    "user stop",
    "reflex",
    "killed bridge",
    "frozen bridge",
    "killed runner",
    "silent targets",
    "NaN targets",
    "second publisher",
    "box exit",
    "hold request",
    "disable request",
    "lost network",
)


class Bench:
    def __init__(self, session, model):
        self.session, self.model = session, model
        self.address = f"127.43.{session.domain}.1"
        session.node("panda_emulator", "-p", f"address:={self.address}")
        self.start_bridge()
        self.ros = session.meet("panda_emulator", "panda_bridge")
        self.path = []
        self.emulator = AsyncParameterClient(self.ros.node, "panda_emulator")
        self.push = self.ros.node.create_publisher(WrenchStamped, "/panda_emulator/wrench", 1)
        fast = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.ros.node.create_subscription(PoseStamped, "/panda_emulator/true_pose", self.on_pose, fast)
        self.states = self.ros.listen(ArmState, "/panda/arm_state")

    def start_bridge(self):
        parameters = (f"model_file:={self.model}", "transport:=fci", f"fci.host:={self.address}", "is_real:=false", "settle_time_s:=0.3")
        self.bridge = self.session.node("panda_bridge", *given(*parameters))

    def on_pose(self, message):
        stamp_s = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        x_m = message.pose.position.x
        self.path.append((stamp_s, x_m, message.pose.position.z))

    def send_push(self, x_n, z_n=0.0):
        message = WrenchStamped()
        message.header.frame_id = "panda_link0"
        message.wrench.force.x, message.wrench.force.z = x_n, z_n
        self.push.publish(message)

    def check_in_time(self):
        """Ends the bench if the true poses arrive late: distances and forces would then be those of a busy machine."""
        late_s = time.time() - self.path[-1][0]
        if late_s > MOST_LATE_S:
            sys.exit(f"the newest true pose is {late_s:.2f} s old: expected at most {MOST_LATE_S} s; run this on an idle machine")

    def fault(self):
        return self.states[-1].fault if self.states else ""

    def prepare(self):
        alone = lambda: list(self.ros.node.get_node_names()).count("panda_bridge") == 1
        self.ros.wait_for(alone, 90, "the end of a bridge that was killed")
        self.ros.wait_for(lambda: self.states and self.states[-1].mode != ArmState.MODE_DISCONNECTED, 20, "a connected arm")
        self.recover()
        goal = MoveToStart.Goal(use_pose=True)
        goal.pose.position.x, goal.pose.position.z, goal.pose.orientation.x = *START_M, 1.0
        goal.pose.orientation.w = 0.0
        for _ in range(20):
            result = Goal(self.ros, MoveToStart, "/panda/move_to_start", goal).end().result
            if result.success:
                return
            # The bridge sets thresholds anew after a connection; the robot may still be recovering.
            self.ros.spin(0.5)
        raise AssertionError(f"the arm does not reach its start: {result.message}")

    def recover(self):
        """Asks for recovery, again if need be: a request can go to the bridge that was killed, before the new one is discovered."""
        for _ in range(12):
            with contextlib.suppress(AssertionError):
                return self.ros.call(Trigger, "/panda/error_recovery", Trigger.Request(), seconds=5)
        raise AssertionError("no answer of /panda/error_recovery")

    def stream(self, speed_m_s, kind="good"):
        words = [sys.executable, HERE / "targets.py", self.session.domain, *START_M, speed_m_s, kind]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        with open(self.session.folder / f"targets_{kind}.err", "wb") as log:
            child = subprocess.Popen(list(map(str, words)), stderr=log, env=self.session.environment, **pipes)
        assert child.stdout.readline() == "ready\n"
        return child

    def trial(self, name, speed_m_s):
        """Returns distance (mm) and time (s) to standstill, how far out of the box (mm), and the reason that the arm gives."""
        self.prepare()
        targets = self.stream(speed_m_s, "nan" if name == "NaN targets" else "good")
        try:
            self.enable()
            self.path.clear()
            targets.stdin.write("\n")
            targets.stdin.flush()
            self.ros.spin(self.time_to_fault(name, speed_m_s))
            self.check_in_time()
            at_s = self.path[-1][0]
            undo = self.inject(name, targets)
            self.ros.holds_within(lambda: self.still_since(at_s) is not None, WATCH_S)
            self.check_in_time()
            reason = self.fault()
            result = self.measured(at_s)
            undo()
            return (*result, reason)
        finally:
            self.end(targets)

    def enable(self):
        """Enables the arm, again if need be: the bridge sees the publisher of a killed process until its lease ends."""
        until = time.monotonic() + 60
        while not (answer := self.ros.call(SetBool, "/panda/enable", SetBool.Request(data=True))).success:
            assert time.monotonic() < until, answer.message
            self.ros.spin(1)

    def end(self, targets):
        """Ends the publisher of targets, and waits until nobody sees it: the arm refuses to move beside a second one."""
        targets.send_signal(signal.SIGCONT)
        targets.terminate()
        targets.wait()
        self.ros.wait_for(lambda: not self.ros.node.count_publishers("/panda/target_pose"), 60, "the end of the targets")
        self.ros.spin(0.7)

    def time_to_fault(self, name, speed_m_s):
        if name == "box exit":
            # The fault is the wall of the box itself: the arm is watched from a little before it on.
            return (BOX_M - START_M[0]) / speed_m_s - 0.2
        return MOTION_S

    def inject(self, name, targets):
        stop = lambda on: self.ros.call(SetBool, "/panda_emulator/user_stop", SetBool.Request(data=on))
        if name == "user stop":
            stop(True)
            return lambda: stop(False)
        if name == "reflex":
            self.send_push(0.0, PUSH_N)
            return lambda: self.send_push(0.0)
        if name == "killed bridge":
            self.bridge.kill()
            self.bridge.wait()
            self.states.clear()
            return self.start_bridge
        if name == "frozen bridge":
            self.bridge.send_signal(signal.SIGSTOP)
            return self.thaw
        if name == "killed runner":
            targets.kill()
        if name == "silent targets":
            targets.send_signal(signal.SIGSTOP)
        if name == "second publisher":
            other = self.ros.node.create_publisher(PoseStamped, "/panda/target_pose", 1)
            return lambda: self.ros.node.destroy_publisher(other)
        if name == "hold request":
            self.ros.call(Trigger, "/panda/hold", Trigger.Request())
        if name == "disable request":
            self.ros.call(SetBool, "/panda/enable", SetBool.Request(data=False))
        if name == "lost network":
            cut = lambda on: self.ros.call(SetBool, "/panda_emulator/network_cut", SetBool.Request(data=on))
            cut(True)
            return lambda: cut(False)
        return lambda: None

    def thaw(self):
        """Lets a frozen bridge go on: it ends by itself, because it cannot know what it has missed, and a launch starts it anew."""
        self.bridge.send_signal(signal.SIGCONT)
        self.bridge.wait(30)
        self.states.clear()
        self.start_bridge()

    def still_since(self, from_s):
        """Time since which the hand stands, or None. All samples of the window count, so that a reversal is no standstill."""
        if not self.path or self.path[-1][0] < from_s + STILL_S:
            return None
        newest_s, x_m, z_m = self.path[-1]
        window = [p for p in self.path if newest_s - p[0] <= STILL_S]
        still = all(math.hypot(x - x_m, z - z_m) < STILL_M_S * STILL_S for _, x, z in window)
        return window[0][0] if still else None

    def measured(self, at_s):
        """Farthest place (mm) from where the fault found the hand, time (s) to standstill, and farthest place out of the box (mm)."""
        since_s = self.still_since(at_s)
        after = [p for p in self.path if p[0] >= at_s]
        _, x_m, z_m = after[0]
        farthest = max(math.hypot(x - x_m, z - z_m) for _, x, z in after)
        out = max(max(x - BOX_M, 0.0) for _, x, _ in self.path)
        time_s = math.nan if since_s is None else max(0.0, since_s - at_s)
        return 1e3 * farthest, time_s, 1e3 * out

    def blocked(self, speed_m_s):
        """Greatest force on a wall in the way, N, the time until the arm gives up, s, and the reason."""
        self.prepare()
        targets = self.stream(speed_m_s)
        wall_m = START_M[0] + 0.05
        try:
            self.enable()
            self.path.clear()
            self.put_wall(wall_m)
            targets.stdin.write("\n")
            targets.stdin.flush()
            begun = time.monotonic()
            stopped = lambda: self.states[-1].mode not in (ArmState.MODE_TRACKING, ArmState.MODE_HOLD)
            self.ros.spin(0.3)
            self.ros.holds_within(stopped, 20)
            elapsed_s = time.monotonic() - begun - 0.05 / speed_m_s
            self.ros.spin(0.5)
            return max(WALL_N_M * max(0.0, x_m - wall_m) for _, x_m, _ in self.path), elapsed_s, self.fault()
        finally:
            self.put_wall(0.0)
            self.end(targets)

    def put_wall(self, x_m):
        """Puts a wall into the emulator, whose plant computes its force; 0: none."""
        wanted = [Parameter("wall.x_m", value=x_m), Parameter("wall.stiffness_n_m", value=WALL_N_M)]
        answer = self.ros.result(self.emulator.set_parameters(wanted), 20, "an answer of the emulator's parameters")
        assert all(result.successful for result in answer.results), answer


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speeds", default="0.05,0.1,0.25", help="speeds of the target, m/s")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--faults", default=",".join(FAULTS))
    parser.add_argument("--logs", type=pathlib.Path, help="folder that keeps the logs of the nodes")
    arguments = parser.parse_args()
    speeds = [float(s) for s in arguments.speeds.split(",")]
    if arguments.logs:
        arguments.logs.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, session_in((arguments.logs or pathlib.Path(folder)).resolve()) as session:
        bench = Bench(session, session.root / "launch_configs/models/soft_bar.yaml")
        worst_mm, worst_n = 0.0, 0.0
        print(
            "| fault | speed, m/s | farthest place after the fault, mm (greatest) | s (greatest) | out of the box, mm (greatest) | reason |"
        )
        print("|---|---|---|---|---|---|")
        for name in arguments.faults.split(","):
            for speed in speeds:
                rows = [bench.trial(name, speed) for _ in range(arguments.repeats)]
                mm, s, out = ([row[i] for row in rows] for i in range(3))
                worst_mm = max(worst_mm, *out)
                words = [f"{statistics.median(v):.{d}f} ({max(v):.{d}f})" for v, d in ((mm, 1), (s, 2), (out, 1))]
                print(f"| {name} | {speed} | {' | '.join(words)} | {rows[-1][3]} |", flush=True)
        print()
        print("| wall | speed, m/s | greatest force, N | given up after, s | reason |")
        print("|---|---|---|---|---|")
        for speed in speeds:
            rows = [bench.blocked(speed) for _ in range(arguments.repeats)]
            worst_n = max(worst_n, *(row[0] for row in rows))
            print(
                f"| {WALL_N_M:.0f} N/m | {speed} | {max(r[0] for r in rows):.1f} | {max(r[1] for r in rows):.2f} | {rows[-1][2]} |",
                flush=True,
            )
        if worst_mm > MOST_OUT_MM or worst_n > MOST_FORCE_N:
            sys.exit(f"{worst_mm:.1f} mm out of the box, {worst_n:.1f} N: expected at most {MOST_OUT_MM} mm and {MOST_FORCE_N} N")


if __name__ == "__main__":
    os.environ.setdefault("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    main()
