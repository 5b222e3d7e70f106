"""Processes of a test in a DDS domain of their own, and a node of rclpy beside them."""

import atexit
import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import uuid

from . import contract
from .domains import Domain
from .program import PROGRAM, ROOT, completed
from .ros import Ros, sees
from .waiting import wait_for

# Logs and states go to a folder of their own, also those of rclpy in this process, so that the user's are left alone.
os.environ["ROS_HOME"] = tempfile.mkdtemp(prefix="catenary_tests_")
os.environ.pop("ROS_LOG_DIR", None)
atexit.register(shutil.rmtree, os.environ["ROS_HOME"], ignore_errors=True)

# Profile that launch_configs/README.md gives to users of Fast DDS: the default one drops most images.
os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(ROOT / "launch_configs/fastdds_localhost.xml"))

# Variable that all processes of a session inherit, so that those of a killed launch are found, too.
MARK = "CATENARY_TEST_MARK"

# Sessions that have not ended, for the report of a failed test.
running = []


def given(*parameters):
    """Words of a ROS 2 command line that set parameters, each as `NAME:=VALUE`."""
    return [word for parameter in parameters for word in ("-p", parameter)]


class Session:
    """Processes that a test starts, the processes that these start, and their output."""

    wait_for = staticmethod(wait_for)
    nodes = frozenset(contract.NODES)
    root = ROOT

    def __init__(self, folder):
        self.folder = folder
        self.claim = Domain()
        self.domain = self.claim.number
        self.mark = uuid.uuid4().hex
        own = {
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_HOME": str(folder),
            MARK: self.mark,
        }
        self.environment = os.environ | own
        self.children = []
        self.ros = None
        running.append(self)

    def start(self, *arguments, name=None, **options):
        """Starts the program; its output goes to NAME.out and NAME.err in the folder."""
        return self.start_script(PROGRAM, *arguments, name=name or arguments[0], **options)

    def start_script(self, *command, name, **options):
        """Starts any program; its output goes to NAME.out and NAME.err in the folder. `options`: of Popen."""
        with open(self.folder / f"{name}.out", "wb") as out, open(self.folder / f"{name}.err", "wb") as err:
            child = subprocess.Popen(
                list(map(str, command)), env=self.environment, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                start_new_session=True, **options,
            )  # fmt: skip
        self.children.append(child)
        return child

    def run(self, *arguments, seconds=120):
        """Runs the program to its end; returns a CompletedProcess with exit code, stdout and stderr."""
        return completed(arguments, self.environment, self.folder, seconds)

    def node(self, name, *arguments, log=None):
        """Starts one node with ROS 2 arguments."""
        return self.start("node", name, "--ros-args", *arguments, name=log or name)

    def stop(self, child, code=0):
        """Interrupts a process, which has to end with this exit code."""
        child.send_signal(signal.SIGINT)
        assert child.wait(10) == code

    def meet(self, *nodes, within=8):
        """Returns a node of rclpy that sees all of these nodes; `launch` says why it may take several attempts."""
        for _ in range(6):
            time.sleep(1)
            self.ros = Ros(self.domain)
            if self.ros.holds_within(lambda: sees(self.ros.node, nodes), within):
                return self.ros
            self.ros.close()
        raise AssertionError(f"rclpy does not see all of {nodes}")

    def launch(self, *arguments, file="sim.launch.xml", nodes=frozenset(contract.NODES)):
        """Starts the nodes of a launch file, and a node of rclpy that sees all of them; returns the launch's process.

        A participant of Fast DDS that begins while nodes on RustDDS 0.15.1 make their endpoints may never hear of some of them
        (nodes/ros/shell, `settle.rs`). So rclpy begins when the nodes are there, and begins anew if it missed some all the same.
        """
        launch = self.start("launch", ROOT / "launch_configs" / file, "--log", self.folder / "log", *arguments)

        def complete():
            assert launch.poll() is None, "the launch ended by itself"
            return sees(self.ros.node, nodes)

        self.wait_for(lambda: all(map(self.pid_of, nodes)), 20, "a process for each node")
        for _ in range(6):
            time.sleep(1)
            self.ros = Ros(self.domain)
            if self.ros.holds_within(complete, 8):
                return launch
            self.ros.close()
        raise AssertionError("rclpy does not see all nodes of the launch")

    def processes(self):
        """Ids and command lines of all living processes with the session's mark; zombies have no environment and are left out."""
        found, mark = {}, f"{MARK}={self.mark}".encode()
        for folder in pathlib.Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if mark in (folder / "environ").read_bytes().split(b"\0"):
                    found[int(folder.name)] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        return found

    def pid_of(self, node):
        """Id of the process of a node of the launch; None while it is down."""
        return next((pid for pid, words in self.processes().items() if f" node {node} " in words), None)

    def wait_until_empty(self, seconds):
        self.wait_for(lambda: not self.processes(), seconds, f"the end of {list(self.processes().values())}")

    def text(self, name):
        return (self.folder / name).read_text()

    def end_children(self):
        """Interrupts the processes that were started, and kills those that stay."""
        for child in self.children:
            if child.poll() is None:
                child.send_signal(signal.SIGINT)
        for child in self.children:
            try:
                child.wait(10)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()

    def end(self):
        running.remove(self)
        if self.ros:
            self.ros.close()
        self.end_children()
        for pid in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.claim.give_back()


@contextlib.contextmanager
def session_in(folder):
    """Session whose output goes to `folder`; all its processes have ended afterwards."""
    assert PROGRAM.exists(), f"{PROGRAM} is missing: cargo build --release"
    session = Session(folder)
    try:
        yield session
    finally:
        session.end()
