"""`catenary launch` starts processes again up to their limit, ends them in order, and reports both."""

import json
import os
import pathlib
import pty
import shutil
import signal
import subprocess
import time
from xml.sax.saxutils import escape

import pytest

from support.program import PROGRAM
from support.waiting import wait_for


class Launch:
    """A launch of shell processes, its log folder and its table of processes."""

    def __init__(self, program, folder, *elements, log=True):
        (folder / "x.launch.xml").write_text("<launch>\n" + "\n".join(elements) + "\n</launch>\n")
        self.program, self.folder, self.environment = program, folder, {"ROS_LOG_DIR": str(folder / "ros")}
        self.log = ("--log", folder / "log") if log else ()
        with open(folder / "out", "wb") as out, open(folder / "err", "wb") as err:
            command = [PROGRAM, "launch", folder / "x.launch.xml", "--json", *self.log]
            own = program.environment(**self.environment)
            self.process = subprocess.Popen(list(map(str, command)), cwd=folder, env=own, stdout=out, stderr=err)

    def status(self, *arguments):
        """Runs `catenary status` for this launch; returns the CompletedProcess."""
        return self.program("status", *self.log, *arguments, seconds=20, **self.environment)

    def rows(self):
        """Rows of the table by name; empty before there is a table."""
        done = self.status("--json")
        return {row["name"]: row for row in json.loads(done.stdout)["processes"]} if done.stdout else {}

    def wait_for(self, condition, what, seconds=20):
        """Returns the first true value of `condition(rows)`."""
        try:
            return wait_for(lambda: condition(self.rows()), seconds, what)
        except AssertionError as error:
            raise AssertionError(f"{error}: {self.rows()} {self.err()}") from None

    def err(self):
        return (self.folder / "err").read_text()

    def end(self, number=signal.SIGINT):
        """Ends the launch by a signal; returns its exit code and the table that it printed."""
        self.process.send_signal(number)
        code = self.process.wait(20)
        return code, json.loads((self.folder / "out").read_text())


@pytest.fixture
def launch(program, tmp_path):
    """Starts launches of XML elements, which are interrupted at the end of the test."""
    launches = []

    def start(*elements, **options):
        launches.append(Launch(program, tmp_path, *elements, **options))
        return launches[-1]

    yield start
    for each in launches:
        if each.process.poll() is None:
            each.process.send_signal(signal.SIGINT)
            each.process.wait(20)


def lives(pid):
    """Tells whether a process runs; a zombie does not."""
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(") ")[1][0] != "Z"
    except OSError:
        return False


def script(name, text, attributes=""):
    """Element of a launch file that runs a line of shell."""
    return f"""<executable name="{name}" cmd="sh -c '{escape(text)}'" {attributes}/>"""


def running(*names):
    """Condition that all of these processes run; its value are the rows."""
    return lambda rows: all(rows.get(name, {}).get("state") == "running" for name in names) and rows


def test_a_killed_process_is_started_again_and_the_table_says_so(launch):
    respawn = 'respawn="true" respawn_delay="0.3" respawn_max_retries="5"'
    graph = launch(script("a", "exec sleep 60", respawn), script("b", "exec sleep 60"))
    first = graph.wait_for(running("a", "b"), "both to run")["a"]
    os.kill(first["pid"], signal.SIGKILL)
    again = graph.wait_for(lambda rows: rows["a"]["restarts"] == 1 and running("a")(rows), "a to be started again")["a"]
    assert again["pid"] != first["pid"] and again["last_exit"] == {"signal": 9} and again["restart_limit"] == 5
    done = graph.status()
    assert done.returncode == 0, done.stderr
    title, names, *rows = done.stdout.splitlines()
    assert title.startswith(str(graph.folder / "x.launch.xml")) and str(graph.folder / "log") in title
    assert names.split() == ["name", "pid", "state", "for", "restarts", "last", "exit", "log"]
    assert [row.split()[0] for row in rows] == ["a", "b"] and "1 of 5" in rows[0] and "signal 9" in rows[0] and "a.log" in rows[0]
    code, table = graph.end()
    assert code == 0 and "a was killed by signal 9 (restarting" in graph.err()
    assert {row["state"] for row in table["processes"]} == {"stopped"} and table["ended_s"] > table["since_s"]


def test_a_crash_loop_ends_at_its_limit_with_a_message(launch):
    respawn = 'respawn="true" respawn_delay="0.05" respawn_max_retries="3"'
    graph = launch(script("loop", "echo no luck >&2; exit 3", respawn), script("b", "exec sleep 60"))
    row = graph.wait_for(lambda rows: rows.get("loop", {}).get("state") == "failed" and rows, "the end of the loop")["loop"]
    assert row["restarts"] == 3 and row["last_exit"] == {"code": 3} and row["pid"] is None
    assert (graph.folder / "log/loop.log").read_text().splitlines() == ["no luck"] * 4
    assert "loop failed with exit code 3: no luck (not restarted: it was restarted 3 times, which is its limit; log " in graph.err()
    assert "the graph runs without loop" in graph.err() and "[loop] no luck" in graph.err()
    done = graph.status()
    assert done.returncode == 1 and done.stderr == "catenary: the launch runs without loop\n"
    code, _ = graph.end()
    assert code == 1 and graph.err().splitlines()[-1] == "catenary: ended with an error: loop"


def test_a_process_that_refuses_its_arguments_is_started_once(launch):
    graph = launch(script("wrong", "exit 2", 'respawn="true"'), script("b", "exec sleep 60"))
    row = graph.wait_for(lambda rows: rows.get("wrong", {}).get("state") == "failed" and rows, "the end of it")["wrong"]
    assert row["restarts"] == 0 and row["last_exit"] == {"code": 2} and "it refuses its arguments" in graph.err()
    assert graph.end()[0] == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_the_end_leaves_no_process_behind(launch, number):
    """One process ends at once, one has a child, one ignores SIGINT, and one ignores SIGTERM, too."""
    times = 'sigterm_timeout="0.5" sigkill_timeout="0.5"'
    graph = launch(
        script("good", "exec sleep 60", times),
        script("parent", "sleep 61 & echo $!; wait", times),
        f"""<executable name="deaf" cmd="sh -c &quot;trap '' INT; echo up; while :; do sleep 0.05; done&quot;" {times}/>""",
        f"""<executable name="deafer" cmd="sh -c &quot;trap '' INT TERM; echo up; while :; do sleep 0.05; done&quot;" {times}/>""",
    )
    pids = [row["pid"] for row in graph.wait_for(running("good", "parent", "deaf", "deafer"), "all to run").values()]
    said = lambda name: (graph.folder / f"log/{name}.log").read_text().split()
    graph.wait_for(lambda _: said("parent") and said("deaf") and said("deafer"), "all to be ready")
    pids += [int(said("parent")[0])]
    begun = time.monotonic()
    code, table = graph.end(number)
    assert code == 0 and time.monotonic() - begun < 10
    graph.wait_for(lambda _: not any(map(lives, pids)), "the end of all", seconds=2)
    exits = {row["name"]: row["last_exit"] for row in table["processes"]}
    assert exits["good"] == {"signal": 2} and exits["deaf"] == {"signal": 15} and exits["deafer"] == {"signal": 9}
    assert "deaf did not end within 0.5 s: SIGTERM" in graph.err() and "deafer did not end within 1.0 s: SIGKILL" in graph.err()
    done = graph.status()
    assert done.returncode == 1 and "ended after" in done.stdout and "is not running" in done.stderr


def test_a_launch_ends_with_a_process_whose_exit_shuts_it_down(launch):
    graph = launch(script("main", "sleep 0.5; exit 4", 'on_exit="shutdown"'), script("b", "exec sleep 60"))
    assert graph.process.wait(20) == 1
    states = {row["name"]: row["state"] for row in json.loads((graph.folder / "out").read_text())["processes"]}
    assert states == {"main": "failed", "b": "stopped"} and "the launch ends with it" in graph.err()


def test_a_launch_ends_well_when_all_its_processes_have(launch):
    hidden, loud = script("b", "echo hidden >&2", 'output="own_log"'), script("c", "echo loud", 'output="screen"')
    graph = launch(script("a", "echo shown"), hidden, loud)
    assert graph.process.wait(20) == 0
    said = [line for line in graph.err().splitlines() if line.startswith(("[a]", "[b]", "[c]"))]
    assert said == ["[c] loud"], "standard output is in the log alone unless the file asks for the screen"
    assert [(graph.folder / f"log/{name}.log").read_text() for name in "abc"] == ["shown\n", "hidden\n", "loud\n"]


def test_logs_lie_in_the_log_folder_of_ros_2_and_the_last_launch_is_found(launch):
    graph = launch(script("a", "exec sleep 60"), log=False)
    row = graph.wait_for(running("a"), "it to run")["a"]
    folder = pathlib.Path(row["log"]).parent
    assert folder.parent == graph.folder / "ros" and folder.name.endswith(f"-{graph.process.pid}")
    assert graph.err().splitlines()[0] == f"catenary launch: logs in {folder}"
    graph.process.kill()
    graph.process.wait()
    done = graph.status()
    assert done.returncode == 1 and "was killed" in done.stdout and "is not running" in done.stderr
    os.kill(row["pid"], signal.SIGKILL)


def test_on_a_terminal_the_table_is_printed_at_each_change(program, tmp_path):
    elements = script("brief", "sleep 0.3; exit 3") + script("long", "exec sleep 60")
    (tmp_path / "x.launch.xml").write_text(f"<launch>{elements}</launch>")
    ours, theirs = pty.openpty()
    try:
        terminal = {"stdin": theirs, "stdout": theirs, "stderr": theirs}
        command = [PROGRAM, "launch", "x.launch.xml", "--log", "log"]
        child = subprocess.Popen(command, cwd=tmp_path, env=program.environment(), **terminal)
        os.close(theirs)
        seen = b""
        deadline = time.monotonic() + 20
        while seen.count(b"brief.log\r\n") < 2 and time.monotonic() < deadline:
            seen += os.read(ours, 4096)
        child.send_signal(signal.SIGINT)
        assert child.wait(20) == 1
    finally:
        os.close(ours)
    rows = [line.split() for line in seen.decode().splitlines() if line.startswith("brief ")]
    assert [row[2] for row in rows] == ["running", "failed"] and "code 3" in seen.decode(), seen.decode()


def test_the_status_says_that_there_was_no_launch(program, tmp_path):
    done = program("status", "--log", tmp_path)
    assert done.returncode == 1 and done.stdout == "" and f"no launch has its logs in {tmp_path}" in done.stderr


def test_processes_go_on_and_are_started_again_although_neither_table_nor_log_can_be_written(launch):
    graph = launch(script("a", "exec sleep 60", 'respawn="true" respawn_delay="0.1"'), script("b", "exec sleep 60"))
    rows = graph.wait_for(running("a", "b"), "both to run")
    shutil.rmtree(graph.folder / "log")
    os.kill(rows["a"]["pid"], signal.SIGKILL)
    wait_for(lambda: "no log in" in graph.err(), 10, "a word about the log")
    assert "cannot show this launch" in graph.err() and lives(rows["b"]["pid"]) and graph.process.poll() is None
    code, table = graph.end()
    assert code == 0 and {row["name"]: row["restarts"] for row in table["processes"]} == {"a": 1, "b": 0}
    assert not lives(rows["b"]["pid"])


def test_a_missing_working_directory_is_named(launch):
    graph = launch("""<executable name="a" cmd="sleep 1" cwd="/not/there"/>""")
    assert graph.process.wait(10) == 1
    assert "cannot start a: cwd: expected a folder, got /not/there" in graph.err()


def test_the_status_of_a_killed_launch_names_the_living_processes(launch):
    graph = launch(script("a", "exec sleep 60"))
    pid = graph.wait_for(running("a"), "a to run")["a"]["pid"]
    graph.process.kill()
    graph.process.wait(10)
    try:
        assert "was killed, and a may still run" in graph.status().stdout
    finally:
        os.kill(pid, signal.SIGKILL)
    graph.wait_for(lambda _: not lives(pid), "the end of a")
    assert "was killed, and its processes with it" in graph.status().stdout
