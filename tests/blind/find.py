"""Runs the effect finder on the drawn worlds: each bag of a world has its role. It reads no sealed answer.

    source .venv/ros.env; .venv/bin/python tests/blind/find.py --out DIR [--null-sets 99] [--seed 1] [--part I/N]

Worlds with a finding are not searched again, and an interrupted search goes on. Each world has its own seed, and so should each part:
searches with one seed test against the same noise, so that their p-values are too low or too high together.
"""

import argparse
import os
import pathlib
import subprocess
import sys

from alone import alone

# Upper bound of the worlds of a part, so that seeds of two parts never meet.
MOST_WORLDS = 100_000
ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary")
# Role of each bag in a search.
ROLES = {"--bag": "bag_0", "--validate": "bag_1", "--verify": "bag_2"}


def search(world, found, null_sets, seed):
    """Searches a world, and moves the complete finding to its place."""
    half = found.with_suffix(".half")
    bags = [a for option, bag in ROLES.items() for a in (option, world / bag)]
    files = ["--model", world / "model.yaml", *bags, "--out", half]
    command = [PROGRAM, "find-effects", *files, "--null-sets", null_sets, "--seed", seed]
    done = subprocess.run(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        print(f"{world.name}: {done.stderr.splitlines()[-1:]}", file=sys.stderr)
        return
    half.rename(found)


def part(text):
    """Number of a part, from 0, and number of parts."""
    number, _, of = text.partition("/")
    if not (number.isdigit() and of.isdigit() and 1 <= int(number) <= int(of)):
        raise argparse.ArgumentTypeError(f"expected I/N with 1 <= I <= N, got {text}")
    return int(number) - 1, int(of)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--null-sets", type=int, default=99)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", type=part, default=(0, 1), help="part I of N of the worlds, for several machines with one folder")
    arguments = parser.parse_args()
    if not (arguments.out / "seals.txt").exists():
        sys.exit(f"{arguments.out / 'seals.txt'}: expected the seals of all worlds; run draw.py to its end first")
    number, of = arguments.part
    arguments.lock = alone(arguments.out if of == 1 else arguments.out / f"part-{number + 1}-of-{of}")
    (arguments.out / "found").mkdir(exist_ok=True)
    worlds = sorted(w for w in (arguments.out / "worlds").iterdir() if w.is_dir() and not w.suffix)
    own = worlds[number::of]
    for done, world in enumerate(own):
        found = arguments.out / "found" / world.name
        if not found.exists():
            print(f"world {done + 1} of {len(own)}", file=sys.stderr)
            search(world, found, arguments.null_sets, MOST_WORLDS * arguments.seed + int(world.name))


if __name__ == "__main__":
    main()
