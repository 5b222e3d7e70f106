"""Small study that is made twice, in one process and in parts, and compared."""

import os
import pathlib
import signal
import subprocess
import sys
import time

SMALL = ["--task", "place_tip", "--objects", "dlo_0", "dlo_2", "--seeds", "2", "--steps", "3072", "--episodes", "10"]
SMALL += ["--repeats", "2", "--evidence", "1:3x60"]


class Study:
    """The study in the folders `whole` and `parts` of a folder."""

    def __init__(self, program, folder):
        self.program, self.folder = program, pathlib.Path(folder)

    def options(self, out):
        return ["--out", str(self.folder / out), *SMALL]

    def command(self, out, *more):
        return [self.program, "study", *self.options(out), *more]

    def make(self, out):
        """Makes what is missing, and the report. Returns the duration in s."""
        began = time.monotonic()
        subprocess.run(self.command(out), check=True, capture_output=True)
        return time.monotonic() - began

    def process_of(self, part):
        """Process of a part in `parts`, as soon as the folder has a training."""
        folder = self.folder / "parts"
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            for process in pathlib.Path("/proc").glob("[0-9]*"):
                try:
                    words = (process / "cmdline").read_bytes().split(b"\0")
                except OSError:
                    continue
                if part.encode() in words and str(folder).encode() in words and list(folder.rglob("trainings/*.safetensors")):
                    return int(process.name)
            time.sleep(0.02)
        sys.exit(f"expected a process of part {part} that made a training within 120 s, got none")

    def kill(self, part):
        os.kill(self.process_of(part), signal.SIGKILL)

    def files(self, out):
        """Contents of the files but those that a killed process left unfinished."""
        paths = [p for p in (self.folder / out).rglob("*") if p.is_file() and "unfinished" not in p.name]
        return {p.relative_to(self.folder / out): p.read_bytes() for p in paths}

    def compare(self):
        """Ends the program if a file of the parts differs from that of one process."""
        one, merged = self.files("whole"), self.files("parts")
        different = [str(path) for path in one.keys() | merged.keys() if one.get(path) != merged.get(path)]
        if different:
            sys.exit(f"{len(different)} of {len(one)} files differ: {different[:5]}")
        print(f"all {len(one)} files are equal")
