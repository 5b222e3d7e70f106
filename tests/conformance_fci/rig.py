"""Server and clients of the checks, each a process of its own.

A client is a script. It says `server INSTRUCTION` on stdout to have the server do something, and reads the answer on stdin. Its last
line is the row of the check. Clients do not get the right to real-time scheduling, which libfranka takes if it may: priority 99 of a
client would stall the server.

CATENARY_FCI_SERVER: path of the server, target/release/examples/serve by default.
"""

import functools
import importlib.util
import itertools
import os
import pathlib
import queue
import re
import shutil
import subprocess
import sys
import threading

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
SERVER = pathlib.Path(os.environ.get("CATENARY_FCI_SERVER", TARGET / "examples/serve"))
MODEL_LIBRARY = TARGET / "libpanda_model_library.so"

# Column of the table: name, script, module that the script imports, generation of the robot.
CLIENTS = {
    "bytes": ("by_bytes", "socket", "panda"),
    "panda-python": ("with_panda_python", "panda_py", "panda"),
    "pylibfranka": ("with_pylibfranka", "pylibfranka", "fr3"),
    "franky": ("with_franky", "franky", "fr3"),
}

# Row of the table by number.
CHECKS = {
    1: "version",
    2: "states",
    3: "setters",
    4: "torque loop",
    5: "generators and limits",
    6: "torque rate",
    7: "contact",
    8: "lost commands",
    9: "stop",
    10: "user stop",
    11: "end while moving",
    12: "lost states",
    13: "client dies",
    14: "pose and gravity",
    15: "unknown load",
    16: "one end a motion",
    17: "model library",
    18: "same bytes",
}

# libfranka knows one port, so that each server has an address of its own. The second number differs between processes of pytest.
_addresses = (f"127.{64 + os.getpid() % 128}.{i // 250}.{1 + i % 250}" for i in itertools.count())


def next_address():
    """Loopback address that no other server has."""
    return next(_addresses)


def cells():
    """All cells of the table that have a check: its number, client and function."""
    for client, (script, _, _) in CLIENTS.items():
        source = (HERE / "clients" / f"{script}.py").read_text()
        for function, number in re.findall(r"^def (check_(\d\d)\w*)\(", source, re.MULTILINE):
            yield int(number), client, function


def why_missing(client):
    """Reason why a client cannot run here; None if it can."""
    module = CLIENTS[client][1]
    if importlib.util.find_spec(module) is None:
        return f"no module {module}: pip install -r tests/conformance_fci/requirements.txt"
    return None


@functools.cache
def without_real_time():
    """Words before a command that take its right to real-time scheduling. Only root has it."""
    if os.geteuid() != 0:
        return ()
    assert shutil.which("setpriv"), "as root, setpriv (util-linux) is needed to take a client's right to real-time scheduling"
    return ("setpriv", "--inh-caps=-sys_nice", "--bounding-set=-sys_nice", "--")


class Server:
    """Server of the Franka Control Interface with its events. Arguments: those of the example `serve`."""

    def __init__(self, *arguments, pace="lock_step", is_patient=True):
        self.address = next_address()
        # A client on a busy machine may stand still for longer than the server's usual patience, after which cycles go on without it.
        patience = ["patience=20"] if is_patient else []
        command = [SERVER, f"{self.address}:1337", f"pace={pace}", *patience, *arguments]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, bufsize=1)
        self.events, self._answers = [], queue.Queue()
        assert self.process.stdout.readline().startswith("listening")
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            if line.startswith("done"):
                self._answers.put(line[5:].rstrip("\n"))
            else:
                self.events.append(line.rstrip("\n"))

    def instruct(self, instruction):
        """Has the server do something; returns its answer. `count TEXT` counts the events so far with a text."""
        if instruction.startswith("count "):
            return str(sum(instruction[6:] in event for event in self.events))
        self.process.stdin.write(instruction + "\n")
        answer = self._answers.get(timeout=10)
        assert not answer.startswith("error"), answer
        return answer

    def close(self):
        self.process.stdin.close()
        self.process.kill()
        self.process.wait()


def run(client, function, server, *, seconds=60):
    """Runs a check; returns its row. A check that fails raises AssertionError with the client's messages and the server's events."""
    script = HERE / "clients" / f"{CLIENTS[client][0]}.py"
    command = [*without_real_time(), sys.executable, script, function, server.address]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1)
    late = threading.Timer(seconds, process.kill)
    late.start()
    messages = queue.Queue()
    threading.Thread(target=lambda: messages.put(process.stderr.read()), daemon=True).start()
    lines = []
    for line in process.stdout:
        if line.startswith("server "):
            process.stdin.write(server.instruct(line[7:].strip()) + "\n")
        else:
            lines.append(line.strip())
    code = process.wait()
    late.cancel()
    assert code == 0, "\n".join([f"exit code {code}", messages.get(timeout=5), *lines, "events of the server:", *server.events[-30:]])
    return lines[-1]
