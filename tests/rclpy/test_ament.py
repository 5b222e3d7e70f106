"""The ament packages that `catenary install` lays out and that colcon builds from the same files, as ROS 2 finds them."""

import json
import os
import pathlib
import shutil
import subprocess
import sys

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from catkin_pkg.package import parse_package

from support.contract import NODES
from support.program import ROOT

ALL_NODES = set(NODES) | {"panda_bridge", "panda_emulator", "recorder", "replayer"}


def run(*command, **options):
    """Runs any program to its end; returns a CompletedProcess. `options`: of subprocess.run."""
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, **options)


def executables(package):
    """Path of each executable of a package by name, found as `ros2 run` does: every executable file below lib/PACKAGE."""
    folder = pathlib.Path(get_package_prefix(package)) / "lib" / package
    paths = [pathlib.Path(root, name) for root, _, names in os.walk(folder) for name in names]
    return {path.name: path for path in paths if path.is_file() and os.access(path, os.X_OK)}


@pytest.fixture(scope="module")
def prefix(program, tmp_path_factory):
    """Prefix into which the program was installed, twice: a second installation replaces the first."""
    prefix = tmp_path_factory.mktemp("prefix")
    for _ in range(2):
        report = program.json("install", "--prefix", prefix)
    assert set(report["nodes"]) == ALL_NODES and "sim.launch.xml" in report["launch_files"]
    return prefix


def test_ros2_finds_the_package_and_its_executables(prefix, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}")
    assert get_package_prefix("catenary") == str(prefix)
    found = executables("catenary")
    assert set(found) == ALL_NODES | {"catenary"}
    for name, path in found.items():
        arguments = ["--version"] if name == "catenary" else ["--ros-args", "--nonsense"]
        done = run(path, *arguments, timeout=20)
        if name == "catenary":
            assert done.returncode == 0 and done.stdout.startswith("catenary "), done.stderr
        else:
            assert done.returncode == 2 and done.stderr.startswith(f"{name}: ") and "--nonsense" in done.stderr, done.stderr
    package = parse_package(str(prefix / "share/catenary/package.xml"))
    assert (package.name, package.get_build_type()) == ("catenary", "ament_cmake")
    assert (prefix / "share/catenary/package.xml").read_text() == (ROOT / "nodes/package.xml").read_text()


def test_a_prefix_that_launch_files_cannot_name_is_refused(program, tmp_path):
    done = program("install", "--prefix", tmp_path / "a prefix")
    assert done.returncode == 2 and "a prefix" in done.stderr
    assert "--prefix: expected a path that launch files can name" in done.stderr


def test_installed_launch_files_start_installed_nodes(prefix, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}")
    monkeypatch.delenv("CATENARY_BIN", raising=False)
    share = pathlib.Path(get_package_share_directory("catenary"))
    files = sorted((share / "launch").glob("*.launch.xml"))
    assert {path.name for path in files} == {path.name for path in (ROOT / "launch_configs").glob("*.launch.xml")}
    kinds = ("*.xml", "*/*.yaml", "*/*.csv")
    listing = lambda folder: sorted(str(path.relative_to(folder)) for kind in kinds for path in folder.glob(kind))
    assert listing(share / "launch") == listing(ROOT / "launch_configs")
    for path in files:
        done = run(prefix / "bin/catenary", "launch", path, "--show", "--json")
        assert done.returncode == 0, done.stderr
        processes = json.loads(done.stdout)["processes"]
        assert processes
        for process in processes:
            assert process["command"][0] == f"{prefix}/lib/catenary/{process['name']}"
            assert "/opt/catenary" not in " ".join(process["command"])


def test_the_setup_script_puts_the_package_before_others(prefix):
    script = f". '{prefix}/setup.sh' && catenary --version && echo \"$AMENT_PREFIX_PATH\""
    done = run("sh", "-c", script, env=os.environ | {"AMENT_PREFIX_PATH": "/opt/ros/jazzy"})
    assert done.returncode == 0, done.stderr
    version, path = done.stdout.splitlines()
    assert version.startswith("catenary ") and path == f"{prefix}:/opt/ros/jazzy"


def test_completions_are_installed_found_and_valid(prefix):
    share = prefix / "share"
    scripts = {
        "bash": "bash-completion/completions/catenary",
        "zsh": "zsh/site-functions/_catenary",
        "fish": "fish/vendor_completions.d/catenary.fish",
    }
    for shell, path in scripts.items():
        text = (share / path).read_text()
        assert all(word in text for word in ("find-effects", "fidelity", "fine_mesh")), shell
        if shutil.which(shell):
            done = run(shell, "-n", share / path)
            assert done.returncode == 0, done.stderr
    for name in ("setup.sh", "setup.bash"):
        complete = f". '{prefix / name}'; COMP_WORDS=(catenary find); COMP_CWORD=1; _catenary catenary find catenary; "
        complete += 'echo "${COMPREPLY[@]}"; complete -p catenary'
        # Interactive, as a user's shell is; --norc leaves the user's settings out.
        done = run("bash", "--norc", "-i", "-c", complete, stdin=subprocess.DEVNULL)
        found, registered = done.stdout.splitlines()
        assert found == "find-effects" and "_catenary" in registered, done.stderr
    data = run("sh", "-c", f"unset XDG_DATA_DIRS; set -eu; . '{prefix}/setup.sh'; echo $XDG_DATA_DIRS")
    assert data.stdout.strip() == f"{share}:/usr/local/share:/usr/share", data.stderr


def test_man_pages_are_installed_and_valid(prefix):
    folder = prefix / "share/man/man1"
    pages = sorted(path.name for path in folder.iterdir())
    assert {"catenary.1", "catenary-infer.1", "catenary-bench-pool.1"} <= set(pages), pages
    assert ".SH" in (folder / "catenary.1").read_text() and "130" in (folder / "catenary.1").read_text()
    for page in ("catenary.1", "catenary-infer.1"):
        if shutil.which("man"):
            done = run("man", "--warnings", "-l", folder / page, env=os.environ | {"MANPAGER": "cat"})
            assert done.returncode == 0 and done.stderr == "" and "SYNOPSIS" in done.stdout, done.stderr
        if shutil.which("mandoc"):
            done = run("mandoc", "-T", "lint", "-W", "error", folder / page)
            assert done.returncode == 0, done.stdout


def test_an_installed_node_joins_the_graph(prefix, session):
    """Starts the node as `ros2 run catenary keypoint_tracker --ros-args -r __ns:=/lab` does."""
    session.start_script(prefix / "lib/catenary/keypoint_tracker", "--ros-args", "-r", "__ns:=/lab", name="node")
    ros = session.meet("keypoint_tracker")
    assert ("keypoint_tracker", "/lab") in ros.node.get_node_names_and_namespaces()


def colcon(folder, *packages):
    """Builds packages with colcon in `folder`, against the wheels of the environment."""
    venv = pathlib.Path(sys.prefix)
    site = next(venv.glob("lib/python3.*/site-packages"))
    environment = os.environ | {
        "AMENT_PREFIX_PATH": str(venv),
        "PYTHONPATH": str(site),
        "LD_LIBRARY_PATH": str(venv / "lib"),
        "CMAKE_GENERATOR": "Ninja",
        "COLCON_HOME": str(folder / "home"),
    }
    settings = [f"-DCMAKE_PREFIX_PATH={venv}/build/stub;{venv}", f"-DPython3_EXECUTABLE={venv}/bin/python", "-DBUILD_TESTING=OFF"]
    command = [sys.executable, "-m", "colcon", "build", "--base-paths", *packages, "--cmake-args", "-DCMAKE_BUILD_TYPE=MinSizeRel"]
    return run(*command, *settings, cwd=folder, env=environment, timeout=500)


def test_colcon_builds_the_interfaces_as_an_ament_package(tmp_path):
    """Builds the package with one of its messages; tests/environment builds all of them with plain CMake."""
    source = tmp_path / "msgs"
    (source / "msg").mkdir(parents=True)
    for name in ("package.xml", "CMakeLists.txt", "msg/Keypoints.msg"):
        shutil.copy(ROOT / "msgs" / name, source / name)
    package = parse_package(str(source / "package.xml"))
    assert (package.name, package.get_build_type()) == ("catenary_msgs", "ament_cmake")
    done = colcon(tmp_path, source)
    assert done.returncode == 0, done.stderr[-2000:]
    install = tmp_path / "install/catenary_msgs"
    assert (install / "share/ament_index/resource_index/packages/catenary_msgs").exists()
    interfaces = (install / "share/ament_index/resource_index/rosidl_interfaces/catenary_msgs").read_text().split()
    assert "msg/Keypoints.msg" in interfaces
    rows = json.loads((install / "share/catenary_msgs/msg/Keypoints.json").read_text())["type_hashes"]
    (hashes,) = [row for row in rows if row["type_name"] == "catenary_msgs/msg/Keypoints"]
    built = pathlib.Path(os.environ["AMENT_PREFIX_PATH"].split(":")[0]) / "share/catenary_msgs/msg/Keypoints.json"
    assert hashes in json.loads(built.read_text())["type_hashes"]
    script = f". '{tmp_path}/install/local_setup.sh' && echo \"$AMENT_PREFIX_PATH\""
    sourced = run("sh", "-c", script)
    assert sourced.stdout.split(":")[0].strip() == str(install)


def test_colcon_installs_the_nodes(tmp_path):
    """Builds the package by cargo, which finds all crates built already."""
    done = colcon(tmp_path, ROOT / "nodes")
    assert done.returncode == 0, done.stderr[-2000:]
    install = tmp_path / "install/catenary"
    script = f". '{tmp_path}/install/local_setup.sh' && echo \"$AMENT_PREFIX_PATH\" && ls '{install}/lib/catenary'"
    sourced = run("sh", "-c", script)
    assert sourced.returncode == 0, sourced.stderr
    path, *names = sourced.stdout.split()
    assert path.split(":")[0] == str(install) and set(names) == ALL_NODES | {"catenary"}
    assert (install / "share/catenary/launch/sim.launch.xml").exists()
