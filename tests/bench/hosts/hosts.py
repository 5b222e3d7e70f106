"""Table (Markdown) of simulations over several hosts, which are network namespaces here.

    source .venv/ros.env; .venv/bin/python tests/bench/hosts/hosts.py [--simulations 600] [--hosts 3]

Episodes a second are those of the batches, without the training between them. All hosts share the processors of this machine, so on
few processors more hosts are not faster. For the last columns a host's link goes down in the middle of a batch: episodes that other
hosts did in its place, and the time until its silence was noticed. Needs root and the program ip; takes some minutes.
"""

import argparse
import os
import pathlib
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from support import network
from support.laboratory import Laboratory, outcome
from support.session import session_in

HEAD = ("hosts", "episodes/s", "share of each host", "bits equal", "after a cut: done again", "seconds to notice", "bits equal")


def row(*cells):
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def rate(laboratory):
    """Episodes a second over all batches so far."""
    batches = laboratory.seconds_of_batches()
    return sum(episodes for episodes, _ in batches) / sum(seconds for _, seconds in batches)


def yes(holds):
    return "yes" if holds else "NO"


def measure(session, hosts, simulations):
    """Prints a row for each number of hosts."""
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
    """Cells of an inference during which a host is cut off."""
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
    with tempfile.TemporaryDirectory() as folder, session_in(pathlib.Path(folder)) as session:
        measure(session, arguments.hosts, arguments.simulations)


if __name__ == "__main__":
    main()
