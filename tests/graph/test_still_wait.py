"""The wait for a still object is shown to clients of the action and by `catenary deploy`: how long, how much it moves, how long still."""

import math

import pytest
from catenary_msgs.action import MoveToStart, RunEpisode

from support.policy import policy_file
from support.ros import Goal
from support.session import session_in

# A bar that swings for a while after the move to the start.
SOFT = "cell_theta:=[0.25,12000.0]"


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    with session_in(tmp_path_factory.mktemp("still")) as session:
        own = {"policy_runner", "simulated_cell", "camera", "keypoint_tracker"}
        session.launch(SOFT, "learning:=false", nodes=own)
        yield session


def swing(graph):
    """Moves the arm, so that the object swings."""
    goal = MoveToStart.Goal(settle_time=0.1, use_pose=True)
    goal.pose.position.z = 0.42
    goal.pose.orientation.x, goal.pose.orientation.w = 1.0, 0.0
    for x in (0.45, 0.40):
        goal.pose.position.x = x
        result = Goal(graph.ros, MoveToStart, "/panda/move_to_start", goal).result()
        assert result.success, result.message


def test_feedback_has_the_wait_and_predicts_its_end(graph):
    swing(graph)
    goal = Goal(graph.ros, RunEpisode, "/policy_runner/run_episode", RunEpisode.Goal(policy=policy_file(), max_steps=2), seconds=180)
    assert goal.result().success
    waits, steps = [f for f in goal.feedback if f.waiting], [f for f in goal.feedback if not f.waiting]
    assert [f.step for f in steps] == [0, 1] and all(f.waited == 0 for f in steps)
    waited, limit = [f.waited for f in waits], waits[0].motion_limit
    assert waited == sorted(waited) and waited[0] < 1 and limit == 2.0
    assert math.isnan(waits[0].motion) and math.isnan(waits[0].remaining), "nothing is known at first"
    assert max(f.motion for f in waits if f.motion == f.motion) > 2 * limit, "it swings"
    known = [f for f in waits if f.remaining == f.remaining]
    print(f"waited {waited[-1]:.1f} s; predicted ends {[round(f.waited + f.remaining, 1) for f in known]}")
    assert known and known[0].waited > 3
    # The swing of a bar is no exact exponential. The prediction at half of the time tells its size.
    half = next(f for f in known if f.waited >= waited[-1] / 2)
    assert 0.5 * waited[-1] < half.waited + half.remaining < 2 * waited[-1]


def test_deploy_tells_the_wait(graph):
    swing(graph)
    (graph.folder / "policy").write_bytes(policy_file())
    done = graph.run("deploy", "--policy", "policy", "--from-here", seconds=200)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if "stay clear" in line]
    assert "how much it moves is not known yet; waited 0 s" in lines[0]
    assert any("px in a second, 2 px count as still; waited 1" in line for line in lines[1:]), done.stderr
    assert "px count as still; waited" in graph.text("log/policy_runner.log")


def test_a_policy_for_starts_in_motion_begins_at_once(graph):
    swing(graph)
    policy = policy_file(start_speed=0.5)
    goal = Goal(graph.ros, RunEpisode, "/policy_runner/run_episode", RunEpisode.Goal(policy=policy, max_steps=2), seconds=20)
    assert goal.result().success
    assert [f.step for f in goal.feedback] == [0, 1] and not any(f.waiting for f in goal.feedback), "it did not wait"
    why = "policy `constant` was trained for starts in motion, up to 0.5 m/s at the tip"
    assert f"begins at once, without a wait for the object to hang still: {why}" in graph.text("log/policy_runner.log")
    swing(graph)
    (graph.folder / "policy").write_bytes(policy)
    done = graph.run("deploy", "--policy", "policy", "--from-here", seconds=60)
    assert done.returncode == 0, done.stderr
    assert f"the episode begins at once: stay clear; {why}" in done.stderr and "still" not in done.stderr
