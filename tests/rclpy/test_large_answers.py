"""Answers of more than 64 kB: a program on Fast DDS gets a refusal with the reason, at once, and the node says so.

RustDDS 0.15.1 garbles an answer of several fragments (nodes/ros/shell/patches/rustdds-0.15.1-inline-qos-of-fragments.patch). With a
RustDDS that does not, the refusal in nodes/ros/shell/src/dds/service_endpoints.rs must go.
"""

import re

import pytest
from catenary_msgs.action import Train
from catenary_msgs.srv import Simulate
from diagnostic_msgs.msg import DiagnosticArray

from support.program import MODEL
from support.ros import Goal

LIMIT = 65_347
REFUSAL = r"the answer has (\d+) bytes, and one of more than 65347 does not reach this program"


@pytest.fixture(scope="module")
def learning(session_of_module):
    session = session_of_module
    for node in ("simulator_pool", "ppo_trainer"):
        session.node(node)
    session.meet("simulator_pool", "ppo_trainer")
    return session


def simulate(ros, bars, frames):
    """Asks the pool for bars on a short path."""
    request = Simulate.Request(model_yaml=MODEL.read_text(), theta=[0.25, 2e4] * bars, drive=Simulate.Request.DRIVE_GRIP, seed=7)
    request.frame_times = [0.1 * frame for frame in range(frames)]
    grip = request.grip
    grip.time, grip.x, grip.z, grip.pitch = [0.0, 1.0], [0.40, 0.40], [0.42, 0.42], [0.0, 0.0]
    return ros.call(Simulate, "/simulator_pool/simulate", request, 60)


def test_a_large_answer_is_refused_with_its_size_and_the_limit(learning):
    reports = []
    subscription = learning.ros.node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 100)
    # Two bars with 11 frames arrive in some kB; 150 bars do not.
    assert len(simulate(learning.ros, 2, 11).tracks) == 2
    answer = simulate(learning.ros, 150, 11)
    assert not answer.success and not answer.tracks
    said = re.search(REFUSAL, answer.message)
    assert said and int(said[1]) > LIMIT, answer.message
    assert "use a program of catenary" in answer.message
    log = learning.text("simulator_pool.err")
    assert re.search(rf"/simulator_pool/simulate: asked by /stranger \(process \d+\): {REFUSAL}", log), log
    told = lambda: [s for r in reports for s in r.status if s.name == "/simulator_pool" and "too large" in s.message]
    learning.ros.wait_for(told, 10, "the warning on /diagnostics")
    status = told()[0]
    assert status.level == b"\1" and {v.key: v.value for v in status.values}["answers_too_large"] == "1"
    learning.ros.node.destroy_subscription(subscription)


def test_an_answer_just_below_the_limit_arrives_whole(learning):
    # Frames fill an answer in steps of a few hundred bytes.
    size = lambda bars: int(re.search(REFUSAL, simulate(learning.ros, bars, 11).message)[1])
    large, larger = size(150), size(151)
    most = 150 - (large - LIMIT + larger - large - 1) // (larger - large)
    answer = simulate(learning.ros, most, 11)
    assert answer.success and len(answer.tracks) == most, answer.message
    assert not simulate(learning.ros, most + 1, 11).success


def test_a_large_result_of_an_action_is_refused_and_the_goal_has_succeeded(learning):
    goal = Train.Goal(model_yaml=MODEL.read_text(), total_steps=64, environments=2, seed=2, history=64)
    result = Goal(learning.ros, Train, "/ppo_trainer/train", goal, seconds=60).result()
    assert not result.success and re.search(REFUSAL, result.message), result.message
    assert not result.policy
    small = Train.Goal(model_yaml=MODEL.read_text(), total_steps=64, environments=2, seed=2)
    result = Goal(learning.ros, Train, "/ppo_trainer/train", small, seconds=60).result()
    assert result.success and result.policy
