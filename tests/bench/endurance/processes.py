"""Memory and processor time of processes, sampled from /proc each second."""

import contextlib
import os
import pathlib
import threading
import time

TICKS = os.sysconf("SC_CLK_TCK")


def rss_kb(pid):
    """Resident memory of a process."""
    for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    raise ProcessLookupError(pid)


def cpu_s(pid):
    """Processor time of a process so far."""
    # The name in brackets may contain spaces. After it, `state` is field 3, `utime` and `stime` are fields 14 and 15 (proc(5)).
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


class Sampler(threading.Thread):
    """Thread that samples (time in s, RSS in kB, processor time in s) of each process by name until `stop`."""

    def __init__(self, pids, period_s=1.0):
        super().__init__(daemon=True)
        self.pids, self.period_s = pids, period_s
        self.samples = {name: [] for name in pids}
        self.load = []
        self.ended = threading.Event()

    def run(self):
        while not self.ended.wait(self.period_s):
            self.load.append(os.getloadavg()[0])
            for name, pid in self.pids.items():
                # A process that has ended gives no further samples.
                with contextlib.suppress(OSError):
                    self.samples[name].append((time.monotonic(), rss_kb(pid), cpu_s(pid)))

    def stop(self):
        self.ended.set()
        self.join()
