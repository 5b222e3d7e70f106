"""Fixtures of all tests: the program, processes in a DDS domain of their own, a graph, and a search that several folders read."""

import re
import signal

import pytest

from support.domains import Domain
from support.program import MODEL, PROGRAM, Program
from support.ros import MISSING, PYTHON
from support.session import running, session_in


@pytest.fixture(scope="session")
def program():
    """The built program in a domain of its own; see `support.program`."""
    assert PROGRAM.exists(), f"{PROGRAM} is missing: cargo build --release"
    claim = Domain()
    yield Program(claim.number)
    claim.give_back()


@pytest.fixture
def session(tmp_path):
    """Processes of one test."""
    with session_in(tmp_path) as session:
        yield session


@pytest.fixture(scope="module")
def session_of_module(tmp_path_factory):
    """Processes for the tests of a module."""
    with session_in(tmp_path_factory.mktemp("session")) as session:
        yield session


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """One launch of sim.launch.xml for the tests of a module."""
    with session_in(tmp_path_factory.mktemp("graph")) as session:
        session.launch()
        yield session


@pytest.fixture(scope="session")
def hidden_mass(program, tmp_path_factory):
    """Folder and completed process of a search for a hidden tip mass of 6 g, with another such episode held out."""
    folder = tmp_path_factory.mktemp("hidden_mass")
    for name, seed in (("fitted", 5), ("unseen", 6)):
        (folder / name).mkdir()
        hidden = ("--noise", "--effect", "tip_mass_kg=0.006", "--seed", seed, "--out", folder / name / "bag")
        program.text("simulate", "--model", MODEL, "--actions", MODEL.with_name("gallery.csv"), *hidden)
    bags = ("--bag", folder / "fitted/bag", "--verify", folder / "unseen/bag")
    arguments = ("--model", MODEL, "--null-sets", 19, "--out", folder / "found", "--json")
    return folder, program("find-effects", *bags, *arguments, seconds=600)


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
    """Adds the last lines of every process's stderr to the report of a failed test."""
    report = yield
    for session in running if report.failed else []:
        for path in sorted(session.folder.glob("*.err")) + sorted(session.folder.glob("demo/log/*.log")):
            lines = [line[:400] for line in path.read_text(errors="replace").splitlines()[-40:]]
            report.sections.append((str(path.relative_to(session.folder)), "\n".join(lines)))
    return report


def pytest_configure():
    """Makes children hear a closed terminal, whatever started the tests.

    `nohup` and CI runners ignore SIGHUP, which a child inherits, and a node respects. A handler is not inherited.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)
