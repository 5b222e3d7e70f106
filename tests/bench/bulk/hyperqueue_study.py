"""Runs a small study in parts on a local HyperQueue cluster of two workers, kills one part midway, submits it again, and merges.

The same study runs in one process first. Every file of the two has to be equal. The workers of HyperQueue's Python package are threads
of this process, so that the part's process is killed in place of its worker.
"""

import argparse
import sys
import tempfile
import time

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

from small_study import Study


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--parts", type=int, default=4)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        study = Study(arguments.program, folder)
        alone = study.make("whole")
        with LocalCluster(f"{folder}/server") as cluster:
            for _ in range(2):
                cluster.start_worker(WorkerConfig(cores=1))
            client = cluster.client()

            def submit(parts):
                job = Job(default_workdir=folder, max_fails=None)
                for part in parts:
                    job.program(study.command("parts", "--part", part), stdout=f"{folder}/out", stderr=f"{folder}/err")
                return client.submit(job)

            parts = [f"{i + 1}/{arguments.parts}" for i in range(arguments.parts)]
            began = time.monotonic()
            submitted = submit(parts)
            study.kill(parts[0])
            done = client.wait_for_jobs([submitted], raise_on_error=False)
            failed = [] if done else [parts[task] for task in client.get_failed_tasks(submitted)]
            print(f"part {parts[0]} killed; parts that failed: {failed}")
            if failed != parts[:1]:
                sys.exit(f"expected that {parts[0]} fails alone")
            client.wait_for_jobs([submit(failed)])
        study.make("parts")
        print(f"one process {alone:.0f} s, parts {time.monotonic() - began:.0f} s with the one that was killed")
        study.compare()


if __name__ == "__main__":
    main()
