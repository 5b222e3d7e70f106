"""Runs a small study in parts by study.sbatch on a Slurm cluster of this machine alone, requeues one part midway, and merges.

    python3 tests/bench/bulk/slurm_study.py --program target/release/catenary

The same study runs in one process first. Every file of the two has to be equal. Needs the programs of Debian's slurmctld, slurmd,
slurm-client and munge on the PATH; they run as this user with files of their own, and end with the script.
"""

import argparse
import contextlib
import os
import pathlib
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

from small_study import Study

JOB = pathlib.Path(__file__).resolve().parents[3] / "launch_configs/study.sbatch"
NEEDED = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol"]


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@contextlib.contextmanager
def cluster(folder):
    """Slurm cluster with this machine as its one node, of two processors. Gives the environment of its clients."""
    user, host = pwd.getpwuid(os.getuid()).pw_name, socket.gethostname().split(".")[0]
    key = folder / "munge.key"
    key.write_bytes(secrets.token_bytes(1024))
    key.chmod(0o600)
    for name in ("state", "spool"):
        (folder / name).mkdir()
    lines = [
        "ClusterName=one",
        f"SlurmctldHost={host}(127.0.0.1)",
        f"SlurmctldPort={free_port()}",
        f"SlurmdPort={free_port()}",
        f"SlurmUser={user}",
        f"SlurmdUser={user}",
        f"AuthInfo=socket={folder / 'munge.socket'}",
        f"StateSaveLocation={folder / 'state'}",
        f"SlurmdSpoolDir={folder / 'spool'}",
        f"SlurmctldPidFile={folder / 'slurmctld.pid'}",
        f"SlurmdPidFile={folder / 'slurmd.pid'}",
        "ProctrackType=proctrack/linuxproc",
        "TaskPlugin=task/none",
        "SelectType=select/cons_tres",
        "SelectTypeParameters=CR_CPU",
        "ReturnToService=2",
        "MpiDefault=none",
        f"NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN",
        f"PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP",
    ]
    (folder / "slurm.conf").write_text("\n".join(lines) + "\n")
    environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf"), "PATH": os.environ["PATH"] + ":/usr/sbin:/sbin"}
    files = [f"--key-file={key}"] + [f"--{name}={folder / f'munge.{end}'}" for name, end in MUNGE]
    started = [subprocess.Popen(["munged", "--foreground", "--force", *files], env=environment, stderr=subprocess.DEVNULL)]
    try:
        for words in (["slurmctld", "-D", "-L", str(folder / "slurmctld.log")], ["slurmd", "-D", "-L", str(folder / "slurmd.log")]):
            time.sleep(1)
            started.append(subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL))
        yield environment
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
        for process in started:
            process.wait()


MUNGE = [("socket", "socket"), ("pid-file", "pid"), ("log-file", "log"), ("seed-file", "seed")]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", required=True)
    parser.add_argument("--parts", type=int, default=4)
    arguments = parser.parse_args()
    missing = [name for name in NEEDED if not shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin:/sbin")]
    if missing:
        sys.exit(f"{', '.join(missing)}: expected on the PATH: apt-get install slurmctld slurmd slurm-client munge")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        study = Study(str(pathlib.Path(arguments.program).resolve()), folder)
        alone = study.make("whole")
        with cluster(folder) as environment:

            def ask(*words):
                return subprocess.run(words, env=environment, cwd=folder, check=True, capture_output=True, text=True).stdout

            given = ["--parsable", f"--array=1-{arguments.parts}", "--cpus-per-task=1", str(JOB), *study.options("parts")]
            environment["CATENARY"] = study.program
            began = time.monotonic()
            job = ask("sbatch", *given).strip()
            process = study.process_of(f"1/{arguments.parts}")
            ask("scontrol", "requeue", f"{job}_1")
            while ask("squeue", "--noheader", "--job", job).strip():
                time.sleep(0.5)
            state = ask("scontrol", "show", "job", f"{job}_1")
            if "Restarts=1" not in state.split():
                sys.exit(f"expected that part 1 was started again, got {state}")
            print(f"part 1 requeued at process {process}: {' '.join(w for w in state.split() if w.startswith(('Restarts', 'JobState')))}")
        study.make("parts")
        print(f"one process {alone:.0f} s, parts {time.monotonic() - began:.0f} s with the one that was requeued")
        study.compare()


if __name__ == "__main__":
    main()
