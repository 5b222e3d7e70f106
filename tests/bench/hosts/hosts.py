"""Simulations over several hosts, which are network namespaces here: a table in Markdown.

    source .venv/ros.env; .venv/bin/python tests/bench/hosts/hosts.py [--simulations 600] [--hosts 3]

Episodes a second are those of the batches, without the training of the network between them. All hosts share this machine's
processors: where these are few, more hosts simulate no faster. Cut off: a host's cable is pulled in the middle of a batch and stays
so; how many of its episodes others did again, and how long it took to notice. Needs root and the program ip.
"""

import argparse
import os
import pathlib
import sys
import tempfile

TESTS = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(TESTS), str(TESTS / "hosts")]

import network  # noqa: E402
from conftest import session_in  # noqa: E402
from laboratory import Laboratory, outcome  # noqa: E402

HEAD = ("hosts", "episodes/s", "share of each host", "bits equal", "after a cut: done again", "seconds to notice", "bits equal")


def row(*cells):
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def rate(laboratory):
    batches = laboratory.seconds_of_batches()
    return sum(episodes for episodes, _ in batches) / sum(seconds for _, seconds in batches)


def yes(holds):
    return "yes" if holds else "NO"


def measure(session, hosts, simulations):
    laboratory = Laboratory(session, hosts)
    sizes = {"simulations": simulations}
    reference = None
    try:
        for host in range(1, hosts + 1):
            laboratory.pool(host)
        row(*HEAD)
        row(*("---" for _ in HEAD))
        for count in range(1, hosts + 1):
            names = ",".join(f"/host{host}" for host in range(1, count + 1))
            laboratory.bayes(names)
            answer = laboratory.infer(**sizes)
            assert answer["success"], answer["message"]
            reference = reference or outcome(answer)
            shares, speed = laboratory.shares(), rate(laboratory)
            total = sum(episodes for episodes, _ in shares.values())
            share = ", ".join(f"{100 * episodes / total:.0f} %" for episodes, _ in shares.values())
            cut = ("", "", "")
            if count > 1:
                cut = cut_off(laboratory, count, names, sizes, reference)
            row(count, f"{speed:.0f}", share, yes(outcome(answer) == reference), *cut)
    finally:
        laboratory.close()


def cut_off(laboratory, host, names, sizes, reference):
    laboratory.bayes(names)
    child = laboratory.ask(**sizes)
    cut_s = laboratory.cut_at_work(host)
    try:
        seconds = laboratory.notice(host) - cut_s
        answer = laboratory.answer(child)
        return laboratory.shares()[host][1], f"{seconds:.1f}", yes(outcome(answer) == reference)
    finally:
        laboratory.hosts.mend(host)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--simulations", type=int, default=600)
    parser.add_argument("--hosts", type=int, default=3)
    arguments = parser.parse_args()
    if reason := network.why_not():
        sys.exit(f"hosts: {reason}")
    print(f"{os.cpu_count()} processors for all hosts", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        sessions = session_in(pathlib.Path(folder))
        try:
            measure(next(sessions), arguments.hosts, arguments.simulations)
        finally:
            sessions.close()


if __name__ == "__main__":
    main()
