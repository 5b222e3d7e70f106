"""Times of the control loop over FCI: computing, response beside libfranka's own loop, and lost cycles.

    source .venv/ros.env; .venv/bin/python tests/bench/fci/loop.py [--cycles 20000] [--minutes 10]

1. Lock step, in turns: the bridge's loop (the example `follow`), and a loop of libfranka 0.9.2 (panda-python) that only returns zeros. The
   emulator measures the time from each state to its command.
2. On the clock, for --minutes, with the whole graph of emulated.launch.xml and a hand that moves to and fro: lost states, success rate
   and computing times, as the bridge tells them on /diagnostics.

Needs `cargo build --release --workspace --lib --examples`. Run it on an idle machine.
"""

import argparse
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))
sys.path.insert(0, str(HERE.parents[1] / "conformance_fci"))

import rig  # noqa: E402
from catenary_msgs.action import MoveToStart  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402

from support.ros import Goal  # noqa: E402
from support.session import session_in  # noqa: E402

FOLLOW = rig.TARGET / "examples/follow"
REPEATS = 5
# Places between which the hand moves on the clock, x and z.
PLACES_M = (0.32, 0.42), (0.42, 0.46)


def responses(server):
    """Number, median, 99th percentile and greatest response since the last call, us."""
    return list(map(int, server.instruct("responses").split()))


def lock_step(cycles):
    ours, theirs, computing = [], [], []
    for _ in range(REPEATS):
        server = rig.Server()
        try:
            responses(server)
            done = subprocess.run([FOLLOW, server.address, str(cycles)], capture_output=True, text=True, check=True)
            computing.append(list(map(float, done.stdout.split())))
            ours.append(responses(server))
            script = [*rig.without_real_time(), sys.executable, HERE / "torques.py", server.address, str(cycles)]
            subprocess.run(list(map(str, script)), check=True, capture_output=True)
            theirs.append(responses(server))
        finally:
            server.close()
    median = lambda rows, column: statistics.median(row[column] for row in rows)
    print("| loop, lock step | cycles | computing p50 / p99 / greatest, us | response p50 / p99 / greatest, us | lost | times real time |")
    print("|---|---|---|---|---|---|")
    compute = " / ".join(f"{median(computing, i):g}" for i in (1, 2, 3))
    answer = lambda rows: " / ".join(str(median(rows, i)) for i in (1, 2, 3))
    print(
        f"| panda_bridge | {median(ours, 0)} | {compute} | {answer(ours)} | {sum(row[4] for row in computing):g} | {median(computing, 5)} |"
    )
    print(f"| libfranka 0.9.2 by panda-python, zeros | {median(theirs, 0)} | - | {answer(theirs)} | - | - |")
    ratios = sorted(a[1] / b[1] for a, b in zip(ours, theirs, strict=True))
    print(
        f"response, ours over theirs: {statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}) in {REPEATS} turns\n",
        flush=True,
    )


def on_the_clock(minutes):
    with tempfile.TemporaryDirectory() as folder, session_in(pathlib.Path(folder)) as session:
        address = f"address:=127.46.{session.domain}.1"
        nodes = session.nodes | {"panda_emulator", "panda_bridge"}
        session.launch(address, file="emulated.launch.xml", nodes=nodes)
        ros, told, rates = session.ros, {}, []

        def keep(message):
            for status in message.status:
                if "panda_" in status.name:
                    told[status.name] = values = {value.key: value.value for value in status.values}
                    if values["robot_mode"] == "Move" and "control_command_success_rate" in values:
                        rates.append(float(values["control_command_success_rate"]))

        ros.node.create_subscription(DiagnosticArray, "/diagnostics", keep, 10)
        moves, end = 0, time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            goal = MoveToStart.Goal(use_pose=True)
            goal.pose.position.x, goal.pose.position.z, goal.pose.orientation.x = *PLACES_M[moves % 2], 1.0
            goal.pose.orientation.w = 0.0
            moved = Goal(ros, MoveToStart, "/panda/move_to_start", goal).end().result
            assert moved.success, moved.message
            moves += 1
        print(f"on the clock, whole graph, {minutes} min, {moves} moves:")
        for name, values in sorted(told.items()):
            print(f"  {name}: {values}")
        print(f"  success rate while moving, least and median: {min(rates)}, {statistics.median(rates)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=20000)
    parser.add_argument("--minutes", type=float, default=10)
    arguments = parser.parse_args()
    if arguments.cycles:
        lock_step(arguments.cycles)
    if arguments.minutes:
        on_the_clock(arguments.minutes)


if __name__ == "__main__":
    main()
