"""Runs the effect finder on the drawn worlds: on the first bag of each, with the others held out. It reads no sealed answer.

    source .venv/ros.env; .venv/bin/python tests/blind/find.py --out DIR [--null-sets 99] [--seed 1]

What was found already is not searched again, and a search that was cut off goes on. Each world has a seed of its own, and so should
each part: searches of one seed test against the same draws of noise, and their p-values lie too low or too high together.
"""

import argparse
import os
import pathlib
import subprocess
import sys

from alone import alone

# Worlds of a part are fewer.
MOST_WORLDS = 100_000
ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary")


def search(world, found, null_sets, seed):
    """Searches, and puts the finding in its place once it is whole."""
    half = found.with_suffix(".half")
    first, *others = sorted(world.glob("bag_*"))
    held_out = [a for bag in others for a in ("--verify", bag)]
    command = [PROGRAM, "find-effects", "--model", world / "model.yaml", "--bag", first, *held_out, "--out", half, "--null-sets", null_sets, "--seed", seed]
    done = subprocess.run(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        print(f"{world.name}: {done.stderr.splitlines()[-1:]}", file=sys.stderr)
        return
    half.rename(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--null-sets", type=int, default=99)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if not (arguments.out / "seals.txt").exists():
        sys.exit(f"{arguments.out / 'seals.txt'}: expected the seals of all worlds, which draw.py writes last")
    arguments.lock = alone(arguments.out)
    (arguments.out / "found").mkdir(exist_ok=True)
    worlds = sorted(w for w in (arguments.out / "worlds").iterdir() if w.is_dir() and not w.suffix)
    for number, world in enumerate(worlds):
        found = arguments.out / "found" / world.name
        if not found.exists():
            print(f"world {number + 1} of {len(worlds)}", file=sys.stderr)
            search(world, found, arguments.null_sets, MOST_WORLDS * arguments.seed + int(world.name))


if __name__ == "__main__":
    main()
