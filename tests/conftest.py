"""Processes of a test in a domain of their own, and a node of rclpy beside them.

CATENARY_PROGRAM: the program to test; target/release/catenary by default.
Without rclpy, or without catenary_msgs built for Python, the tests that need them are skipped.
"""

import atexit
import importlib.util
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid

import domains
import pytest

# Logs and states go to a folder of their own, those of rclpy in this process, too: the user's are left alone.
os.environ["ROS_HOME"] = tempfile.mkdtemp(prefix="catenary_tests_")
os.environ.pop("ROS_LOG_DIR", None)
atexit.register(shutil.rmtree, os.environ["ROS_HOME"], ignore_errors=True)

PYTHON = f"Python {sys.version_info.major}.{sys.version_info.minor}"


def is_missing(name):
    """Whether a package is not installed. The folder tests/rclpy is none, though it can be imported."""
    spec = importlib.util.find_spec(name)
    return spec is None or spec.origin is None


MISSING = [name for name in ("rclpy", "rcl_interfaces", "catenary_msgs") if is_missing(name)]
NO_RCLPY = f"{PYTHON} has no {', '.join(MISSING)} here: see tests/environment"
if not MISSING:
    import contract
    import rclpy
    from rcl_interfaces.msg import Log
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

ROOT = pathlib.Path(__file__).resolve().parents[1]
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
MARK = "CATENARY_TEST_MARK"
NODES = set() if MISSING else set(contract.NODES)

# As the README tells users of Fast DDS.
os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(ROOT / "launch_configs/fastdds_localhost.xml"))

running = []


def wait_for(condition, seconds, what, pause=lambda: time.sleep(0.05)):
    """The first true value of `condition`, which has `seconds` to come."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        pause()
    return value


class Session:
    """Processes that a test starts, those that these start, and their output. All carry a mark in their environment."""

    wait_for = staticmethod(wait_for)
    nodes = NODES
    root = ROOT

    def __init__(self, folder):
        self.folder = folder
        self.claim = domains.Domain()
        self.domain = self.claim.number
        self.mark = uuid.uuid4().hex
        own = {"ROS_DOMAIN_ID": str(self.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_HOME": str(folder), MARK: self.mark}
        self.environment = os.environ | own
        self.children = []
        self.ros = None
        running.append(self)

    def start(self, *arguments, name=None):
        """Starts the program; its output goes to NAME.out and NAME.err in the folder."""
        return self.start_script(PROGRAM, *arguments, name=name or arguments[0])

    def start_script(self, *command, name):
        """Starts any program in the same way."""
        with open(self.folder / f"{name}.out", "wb") as out, open(self.folder / f"{name}.err", "wb") as err:
            child = subprocess.Popen(
                list(map(str, command)), env=self.environment, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                start_new_session=True,
            )  # fmt: skip
        self.children.append(child)
        return child

    def run(self, *arguments):
        """Runs the program to its end."""
        command = [PROGRAM, *map(str, arguments)]
        return subprocess.run(command, env=self.environment, cwd=self.folder, capture_output=True, text=True, timeout=120)

    def node(self, name, *arguments, log=None):
        """Starts one node with ROS 2 arguments."""
        return self.start("node", name, "--ros-args", *arguments, name=log or name)

    def stop(self, child, code=0):
        """Ends a process in order."""
        child.send_signal(signal.SIGINT)
        assert child.wait(10) == code

    def meet(self, *nodes, within=8):
        """A node of rclpy that sees all of these nodes of ours: see `launch`."""
        for _ in range(6):
            time.sleep(1)
            self.ros = Ros(self.domain)
            if self.ros.holds_within(lambda: set(nodes) <= set(self.ros.node.get_node_names()), within):
                return self.ros
            self.ros.close()
        raise AssertionError(f"rclpy does not see all of {nodes}")

    def launch(self, *arguments, file="sim.launch.xml", nodes=NODES):
        """Starts the nodes of a launch file, and a node of rclpy that sees all of its nodes.

        A participant of Fast DDS that begins while nodes on RustDDS 0.15.1 make their endpoints may miss some for good (see
        `settle.rs`), so rclpy begins when the nodes are there, and begins anew where it missed some all the same.
        """
        launch = self.start("launch", ROOT / "launch_configs" / file, "--log", self.folder / "log", *arguments)

        def complete():
            assert launch.poll() is None, "the launch ended by itself"
            return nodes <= set(self.ros.node.get_node_names())

        self.wait_for(lambda: all(map(self.pid_of, nodes)), 20, "a process for each node")
        for _ in range(6):
            time.sleep(1)
            self.ros = Ros(self.domain)
            if self.ros.holds_within(complete, 8):
                return launch
            self.ros.close()
        raise AssertionError("rclpy does not see all nodes of the launch")

    def processes(self):
        """Ids and command lines of all processes with the mark that live; one that has ended and was not waited for does not."""
        found, mark = {}, f"{MARK}={self.mark}".encode()
        for folder in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                if mark in (folder / "environ").read_bytes().split(b"\0"):
                    found[int(folder.name)] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except OSError:
                pass
        return found

    def pid_of(self, node):
        """The process of a node of the launch; none while it is down."""
        return next((pid for pid, words in self.processes().items() if f" node {node} " in words), None)

    def wait_until_empty(self, seconds):
        self.wait_for(lambda: not self.processes(), seconds, f"the end of {list(self.processes().values())}")

    def text(self, name):
        return (self.folder / name).read_text()

    def end(self):
        running.remove(self)
        if self.ros:
            self.ros.close()
        for child in self.children:
            if child.poll() is None:
                child.send_signal(signal.SIGINT)
        for child in self.children:
            try:
                child.wait(10)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        for pid in self.processes():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        self.claim.give_back()


class Ros:
    """A node of rclpy that spins while something is waited for."""

    def __init__(self, domain, name="stranger"):
        if MISSING:
            pytest.skip(NO_RCLPY)
        self.context = rclpy.Context()
        self.context.init(domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def wait_for(self, condition, seconds, what):
        return wait_for(condition, seconds, what, pause=lambda: self.executor.spin_once(timeout_sec=0.05))

    def holds_within(self, condition, seconds):
        """Whether `condition` becomes true in time."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if condition():
                return True
            self.executor.spin_once(timeout_sec=0.05)
        return False

    def result(self, future, seconds, what):
        self.wait_for(future.done, seconds, what)
        return future.result()

    def listen(self, kind, topic, depth=100):
        """A list that messages of a best-effort topic come into."""
        messages = []
        profile = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.node.create_subscription(kind, topic, messages.append, profile)
        return messages

    def listen_log(self):
        """A list that log lines come into, those from before among them."""
        lines = []
        profile = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(Log, "/rosout", lines.append, profile)
        return lines

    def call(self, kind, name, request, seconds=30):
        client = self.node.create_client(kind, name)
        self.wait_for(client.service_is_ready, seconds, f"service {name}")
        return self.result(client.call_async(request), seconds, f"an answer of {name}")

    def close(self):
        if not self.context.ok():
            return
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def session_in(folder):
    assert PROGRAM.exists(), f"{PROGRAM} is missing: cargo build --release"
    session = Session(folder)
    try:
        yield session
    finally:
        session.end()


@pytest.fixture
def session(tmp_path):
    """Processes of one test."""
    yield from session_in(tmp_path)


@pytest.fixture(scope="module")
def session_of_module(tmp_path_factory):
    """Processes for the tests of a module."""
    yield from session_in(tmp_path_factory.mktemp("session"))


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """One launch for the tests of a module."""
    sessions = session_in(tmp_path_factory.mktemp("graph"))
    session = next(sessions)
    try:
        session.launch()
        yield session
    finally:
        sessions.close()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Skips a module that cannot be imported in an environment without rclpy, with the reason."""
    report = yield
    lacks = re.search(r"No module named '([\w.]+)'", str(report.longrepr)) if MISSING and report.failed else None
    if lacks:
        report.outcome = "skipped"
        report.longrepr = (str(collector.path), 0, f"Skipped: {PYTHON} has no {lacks[1]} here: see tests/environment")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """Shows what the processes said where a test fails."""
    report = yield
    for session in running if report.failed else []:
        for path in sorted(session.folder.glob("*.err")) + sorted(session.folder.glob("demo/log/*.log")):
            lines = [line[:400] for line in path.read_text(errors="replace").splitlines()[-40:]]
            report.sections.append((str(path.relative_to(session.folder)), "\n".join(lines)))
    return report


@pytest.fixture(scope="session")
def hidden_mass(tmp_path_factory):
    """A search for what a model lacks, in an episode with 6 g at the tip; another such episode is unseen. Its folder, and the process."""
    folder, model = tmp_path_factory.mktemp("hidden_mass"), ROOT / "launch_configs/models/soft_bar.yaml"
    run = lambda *words: subprocess.run([str(w) for w in (PROGRAM, *words)], capture_output=True, text=True, timeout=600)
    for name, seed in (("fitted", 5), ("unseen", 6)):
        (folder / name).mkdir()
        hidden = ("--noise", "--effect", "tip_mass_kg=0.006", "--seed", seed, "--out", folder / name / "bag")
        made = run("simulate", "--model", model, "--actions", model.with_name("gallery.csv"), *hidden)
        assert made.returncode == 0, made.stderr
    bags = ("--bag", folder / "fitted/bag", "--verify", folder / "unseen/bag")
    return folder, run("find-effects", *bags, "--model", model, "--null-sets", 19, "--out", folder / "found", "--json")
