"""Endurance of the graph of sim.launch.xml: a long recording of successive episodes, and a kill of each node.

    source .venv/ros.env; .venv/bin/python tests/bench/endurance/endurance.py [--minutes 10] [--images] [--only steady|kills] [--json]

It takes the given minutes for the recording, and some minutes more for the kills. Run it on an idle machine.
"""

import argparse
import json
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import kills
import steady
from figures import table
from support.session import session_in


def in_session(part, *arguments):
    """Runs a part of the bench in a session; prints the processes' stderr if it fails."""
    with tempfile.TemporaryDirectory(prefix="endurance_") as folder, session_in(pathlib.Path(folder)) as session:
        try:
            return part(session, *arguments)
        except BaseException:
            for path in sorted(session.folder.glob("*.err")):
                print(f"--- {path.name}", *path.read_text(errors="replace").splitlines()[-30:], sep="\n", file=sys.stderr)
            raise


def tables_of_steady(figures):
    keys = ("start_kb", "warm_kb", "end_kb", "most_kb", "kb_per_min", "low", "high")
    yield table("memory", ["start kB", "warm kB", "end kB", "most kB", "kB/min", "from", "to", "CPU %"], {
        name: [*(row[key] for key in keys), 100 * row["cpu"]] for name, row in figures["memory"].items()
    })  # fmt: skip
    keys = ("told", "sent", "rclpy", "bag", "differ")
    yield table("reliable topic", ["of episodes", "sent", "to rclpy", "in the bag", "in one alone"], {
        name: [row[key] for key in keys] for name, row in figures["messages"].items()
    })  # fmt: skip
    yield table("stream", ["Hz", "p99 ms", "max ms", "dropped %", "lost to rclpy %", "lost to the bag %"], {
        name: [row["hz"], row["p99_ms"], row["max_ms"], *(100 * row[key] for key in ("dropped", "lost_rclpy", "lost_bag"))]
        for name, row in figures["streams"].items()
    })  # fmt: skip


def table_of_kills(rows):
    keys = ("process_s", "flows_s", "served_s", "end_s", "stopped_s", "moved_m", "mode", "next_s")
    columns = ["process s", "topics s", "served s", "end s", "arm stops s", "then moves mm", "mode", "next episode s"]
    scale = {"moved_m": 1e3}
    yield table("killed", columns, {
        row["victim"]: [row[key] if row[key] is None else row[key] * scale.get(key, 1) for key in keys] for row in rows
    })  # fmt: skip
    ends = [["the episode went on" if row["went_on"] else row["end"], *row["refusals"]] for row in rows]
    yield "\n".join(f"{row['victim']}: {'; '.join(end)}" for row, end in zip(rows, ends))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10, help="of the recording")
    size = f"{steady.IMAGES_GB_PER_MIN} GB a minute, 2 of them kept"
    parser.add_argument("--images", action="store_true", help=f"record the images, too: {size}")
    parser.add_argument("--only", choices=["steady", "kills"], help="one part")
    parser.add_argument("--victims", nargs="+", choices=kills.VICTIMS, default=kills.VICTIMS)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    say = lambda line: print(line, file=sys.stderr, flush=True)
    found, held, parts = {}, [], []
    if arguments.only != "kills":
        found["steady"] = head = in_session(steady.run, arguments.minutes, arguments.images, say)
        head["memory"] = steady.memory_of(head)
        held += steady.verdicts(head)
        parts.append(f"{head['episodes']} episodes in {head['seconds']:.0f} s, load {head['load']:.1f}, bag of {head['bag_mb']:.0f} MB")
        parts += tables_of_steady(head)
    if arguments.only != "steady":
        found["kills"] = in_session(kills.run, arguments.victims, say)
        held += kills.verdicts(found["kills"])
        parts += table_of_kills(found["kills"])
    held = [(what, bool(holds)) for what, holds in held]
    parts.append("\n".join(f"{'holds' if holds else 'FAILS'}  {what}" for what, holds in held))
    print(json.dumps(found | {"verdicts": held}, indent=2) if arguments.json else "\n\n".join(parts))
    sys.exit(not all(holds for _, holds in held))


if __name__ == "__main__":
    main()
