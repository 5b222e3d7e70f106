"""Runs a small study in parts on a local HyperQueue cluster of two workers, kills one part midway, submits it again, and merges.

The same study runs in one process first. Every file of the two has to be equal. The workers of HyperQueue's Python package are threads
of this process, so that the part's process is killed in place of its worker.
"""

import argparse
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

SMALL = ["--task", "place_tip", "--objects", "dlo_0", "dlo_2", "--seeds", "2", "--steps", "3072", "--episodes", "10"]
SMALL += ["--repeats", "2", "--evidence", "1:3x60"]


def files(folder):
    """Contents of the files but those that a killed process left unfinished."""
    paths = [p for p in folder.rglob("*") if p.is_file() and "unfinished" not in p.name]
    return {p.relative_to(folder): p.read_bytes() for p in paths}


def kill_part(part, folder):
    """Kills the process of a part in the folder as soon as there is a training."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                words = (process / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if part.encode() in words and str(folder).encode() in words and list(folder.rglob("trainings/*.safetensors")):
                os.kill(int(process.name), signal.SIGKILL)
                return True
        time.sleep(0.02)
    return False


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--parts", type=int, default=4)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)

        def command(out, *more):
            return [arguments.program, "study", "--out", str(folder / out), *SMALL, *more]

        began = time.monotonic()
        subprocess.run(command("whole"), check=True, capture_output=True)
        alone = time.monotonic() - began
        with LocalCluster(str(folder / "server")) as cluster:
            for _ in range(2):
                cluster.start_worker(WorkerConfig(cores=1))
            client = cluster.client()

            def submit(parts):
                job = Job(default_workdir=folder, max_fails=None)
                for part in parts:
                    job.program(command("parts", "--part", part), stdout=str(folder / "out"), stderr=str(folder / "err"))
                return client.submit(job)

            parts = [f"{i + 1}/{arguments.parts}" for i in range(arguments.parts)]
            began = time.monotonic()
            submitted = submit(parts)
            killed = kill_part(parts[0], folder / "parts")
            print(f"part {parts[0]} killed: {killed}")
            done = client.wait_for_jobs([submitted], raise_on_error=False)
            failed = [] if done else [parts[task] for task in client.get_failed_tasks(submitted)]
            print(f"parts that failed: {failed}")
            if failed != parts[:1]:
                sys.exit(f"expected that {parts[0]} fails alone")
            client.wait_for_jobs([submit(failed)])
        subprocess.run(command("parts"), check=True, capture_output=True)
        print(f"one process {alone:.0f} s, parts {time.monotonic() - began:.0f} s with the one that was killed")
        one, merged = files(folder / "whole"), files(folder / "parts")
        different = [str(path) for path in one.keys() | merged.keys() if one.get(path) != merged.get(path)]
        if different:
            sys.exit(f"{len(different)} of {len(one)} files differ: {different[:5]}")
        print(f"all {len(one)} files are equal")


if __name__ == "__main__":
    main()
