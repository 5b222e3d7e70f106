"""Two graphs in one domain: nothing is sent to the other graph, it is named, and every command of an arm is logged with its sender."""

import os
import re
import signal

import pytest
from catenary_msgs.action import MoveToStart
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import SetBool, Trigger

from support.policy import policy_file
from support.program import BAG
from support.ros import Goal
from support.stand_ins import StandIn, Stranger

CELL = {"simulated_cell", "camera", "keypoint_tracker", "policy_runner"}


@pytest.fixture(scope="module")
def cell(session_of_module):
    """Graph of a simulated cell without the learning nodes."""
    session_of_module.launch("learning:=false", nodes=CELL)
    return session_of_module


def move_to_start(ros):
    """Sends a goal for the start pose; returns its result, whether the arm moved or not."""
    goal = Goal(ros, MoveToStart, "/panda/move_to_start", MoveToStart.Goal(settle_time=0.1), seconds=40)
    result = goal.end().result
    goal.client.destroy()
    return result


def deploy(session, name):
    """Runs `catenary deploy`; returns its exit code and stderr."""
    (session.folder / "policy").write_bytes(policy_file())
    child = session.start("deploy", "--policy", "policy", "--wait-s", 20, name=name)
    return child.wait(40), session.text(f"{name}.err")


def test_every_command_of_the_arm_is_logged_with_its_sender(cell):
    assert cell.ros.call(SetBool, "/panda/enable", SetBool.Request(data=True)).success
    assert cell.ros.call(Trigger, "/panda/hold", Trigger.Request()).success
    assert cell.ros.call(SetBool, "/panda/enable", SetBool.Request(data=False)).success
    assert move_to_start(cell.ros).success
    log = cell.text("log/simulated_cell.log")
    who = f"asked for by /stranger (process {os.getpid()})"
    for what in ("enable", "hold", "disable", "move_to_start"):
        assert f"{what}, {who}: done" in log, log
    assert "move_to_start: arrived" in log


def test_an_episode_is_logged_by_runner_and_cell_with_its_sender(cell):
    code, said = deploy(cell, "alone")
    assert code == 0, said
    assert re.search(r"run_episode, asked for by /deploy", cell.text("log/policy_runner.log"))
    log = cell.text("log/simulated_cell.log")
    assert re.search(r"following the targets of /policy_runner \(process \d+\)", log), log
    assert re.search(r"move_to_start, asked for by /deploy.*: done", log), log


def test_the_arm_does_not_move_to_its_start_beside_a_second_publisher_of_targets(cell):
    publisher = cell.ros.node.create_publisher(PoseStamped, "/panda/target_pose", 1)
    try:
        cell.ros.spin(1)
        result = move_to_start(cell.ros)
        code, said = deploy(cell, "crowded")
    finally:
        cell.ros.node.destroy_publisher(publisher)
    assert not result.success and "2 publishers" in result.message, result.message
    assert "/policy_runner" in result.message and f"/stranger (process {os.getpid()})" in result.message
    assert code == 1 and "/panda/target_pose" in said and "/stranger" in said and "nothing was sent" in said
    cell.ros.spin(1)
    assert move_to_start(cell.ros).success, "the stranger left"


def test_the_arm_does_not_move_beside_another_server_of_one_of_its_services(cell):
    with Stranger(cell.domain, services=("/panda/hold",), actions=(), topics=()) as lab:
        cell.ros.spin(1)
        enabled = cell.ros.call(SetBool, "/panda/enable", SetBool.Request(data=True))
        moved = move_to_start(cell.ros)
    assert not enabled.success and "/lab_robot" in enabled.message and "ROS_DOMAIN_ID" in enabled.message
    assert not moved.success and "/lab_robot" in moved.message
    assert lab.received == []


@pytest.mark.parametrize("name", ["/panda/current_pose", "/panda/arm_state"])
def test_the_arm_does_not_move_beside_another_arm_that_only_listens_to_targets(cell, name):
    with Stranger(cell.domain, services=(), actions=(), publishes=(name,)) as lab:
        cell.ros.wait_for(lambda: cell.ros.node.count_publishers(name) == 2, 20, "the stranger")
        cell.ros.spin(1)
        enabled = cell.ros.call(SetBool, "/panda/enable", SetBool.Request(data=True))
        moved = move_to_start(cell.ros)
        code, said = deploy(cell, f"beside_{name[7:]}")
    assert not enabled.success and "/lab_robot" in enabled.message and "ROS_DOMAIN_ID" in enabled.message
    assert not moved.success and "/lab_robot" in moved.message
    assert code == 1 and "/lab_robot" in said and "nothing was sent" in said, said
    assert lab.received == []


def test_a_program_that_only_listens_does_not_keep_the_arm_from_moving(cell):
    with Stranger(cell.domain, services=(), actions=(), topics=("/panda/target_pose", "/panda/current_pose", "/panda/arm_state")) as lab:
        cell.ros.spin(1)
        assert move_to_start(cell.ros).success
    assert "/panda/current_pose" in lab.received


def test_nothing_is_sent_to_a_second_graph(cell):
    with Stranger(cell.domain) as lab:
        cell.ros.wait_for(lambda: "lab_robot" in cell.ros.node.get_node_names(), 20, "the stranger")
        code, said = deploy(cell, "deploy")
        assert code == 1 and "/lab_robot" in said and "/simulated_cell" in said and "ROS_DOMAIN_ID" in said, said
        replayed = cell.run("replay", BAG, "--allow-replay", "--allow-others", "--topics", "/panda/target_pose")
        assert replayed.returncode == 1 and "/lab_robot" in replayed.stderr and "/simulated_cell" in replayed.stderr, replayed.stderr
        cell.ros.spin(1)
    assert lab.received == []


def test_a_second_launch_names_the_running_graph_and_starts_nothing(cell):
    before = cell.processes()
    second = cell.run("launch", cell.root / "launch_configs/sim.launch.xml", "--log", cell.folder / "second")
    assert second.returncode == 1
    (line,) = [line for line in second.stderr.splitlines() if line.startswith("catenary: ")]
    assert f"ROS_DOMAIN_ID {cell.domain}" in line and f"/simulated_cell (process {cell.pid_of('simulated_cell')})" in line, line
    assert not (cell.folder / "second").exists() and set(cell.processes()) == set(before)


def test_no_target_is_replayed_to_an_arm_that_does_not_say_whether_it_is_real(session):
    with Stranger(session.domain) as lab:
        done = session.run("replay", BAG, "--allow-replay")
        assert done.returncode == 1 and "/lab_robot" in done.stderr, done.stderr
        done = session.run("launch", session.root / "launch_configs/sim.launch.xml", "--log", session.folder / "log")
        assert done.returncode == 1 and "/lab_robot" in done.stderr and "ROS_DOMAIN_ID" in done.stderr, done.stderr
    assert lab.received == [] and not session.processes()


def test_a_launch_begins_right_after_the_end_of_another(session):
    for _ in range(2):
        launch = session.launch("learning:=false", nodes=CELL)
        session.ros.close()
        session.stop(launch)


def test_two_demos_and_a_laboratory_do_not_meet(session):
    with StandIn(session.domain, "lab"), Stranger(session.domain) as lab:
        demos = [session.start("demo", "--out", name, name=name) for name in ("first", "second")]
        chosen = set()
        for name in ("first", "second"):
            session.wait_for(lambda name=name: "start the graph: " in session.text(f"{name}.err"), 60, f"the graph of the {name} demo")
            chosen |= set(map(int, re.findall(r"ROS_DOMAIN_ID=(\d+)", session.text(f"{name}.err"))))
        for demo in demos:
            demo.send_signal(signal.SIGINT)
        assert [demo.wait(20) for demo in demos] == [130, 130]
    assert len(chosen) == 2 and session.domain not in chosen, chosen
    assert lab.received == []
