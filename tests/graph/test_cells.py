"""One suite for every cell: whoever commands an arm finds the same topics, rates, frames, stamps, units and episodes, whether the cell
is simulated or the bridge relays to a controller, which is written in rclpy here.

The simulated cell also publishes twist, wrench, transforms and images, which no controller's relay can know.
"""

import array
import math
import sys
import time

import pytest
from action_msgs.msg import GoalStatus
from catenary_msgs.action import MoveToStart, RunEpisode
from catenary_msgs.msg import ArmState, EpisodeEvent
from catenary_msgs.srv import SetCompliance
from conftest import session_in
from contract import BASE, BY_NAME
from geometry_msgs.msg import PoseStamped
from policy import BIAS, policy_file
from rclpy.action import ActionClient
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import SetBool, Trigger

TOPICS = ("/panda/current_pose", "/panda/joint_states", "/panda/arm_state", "/panda/accepted_target")
SERVICES = ("/panda/enable", "/panda/hold", "/panda/error_recovery", "/panda/set_compliance")
MODEL = "launch_configs/models/soft_bar.yaml"
START = (0.40, 0.42)
STEPS = 3


class Cell:
    """The node that has the arm, and a client of it. The runner, which commands, too, comes later."""

    def __init__(self, session, name):
        self.name, self.session = name, session
        model = f"model_file:={session.root / MODEL}"
        if name == "sim":
            self.arm = "simulated_cell"
            session.node(self.arm, "-p", model, "-p", "settle_time_s:=0.2")
            vision = ("camera", "keypoint_tracker")
            for node in vision:
                session.node(node, "--params-file", session.root / "launch_configs/params/sim.yaml")
            others = vision
        else:
            self.arm, others = "panda_bridge", ("cartesian_impedance_controller",)
            session.node(self.arm, "-p", model, "-p", "settle_time_s:=0.2")
            time.sleep(1)
            session.start_script(sys.executable, session.root / "tests/stand_in_lab.py", session.domain, name="lab")
        self.ros = session.meet(self.arm, *others)
        self.heard = {name: [] for name in (*TOPICS, "/dlo/keypoints", "/episode/event", "/policy/action", "/policy/observation")}
        for topic, messages in self.heard.items():
            row = BY_NAME[topic]
            self.ros.node.create_subscription(row.kind, topic, self.keeper(messages), row.profile_of_depth(max(row.depth, 100)))
        self.ros.wait_for(lambda: self.heard["/panda/current_pose"] and self.state, 20, "the arm")
        self.targets = None

    @staticmethod
    def keeper(messages):
        return lambda message: messages.append((message, time.time()))

    def newest(self, topic):
        return self.heard[topic][-1][0] if self.heard[topic] else None

    @property
    def state(self):
        return self.newest("/panda/arm_state")

    @property
    def place(self):
        position = self.newest("/panda/current_pose").pose.position
        return position.x, position.z

    def wait_mode(self, *modes):
        self.ros.wait_for(lambda: self.state.mode in modes, 10, f"a mode of {modes}, not {self.state}")

    def enable(self, on=True):
        answer = self.ros.call(SetBool, "/panda/enable", SetBool.Request(data=on))
        assert answer.success, answer.message
        self.wait_mode(ArmState.MODE_HOLD, ArmState.MODE_TRACKING) if on else self.wait_mode(ArmState.MODE_IDLE)

    def command(self, x, z, frame=BASE, age_s=0.0, norm=1.0):
        """What the gate answers to a target."""
        if self.targets is None:
            row = BY_NAME["/panda/target_pose"]
            self.targets = self.ros.node.create_publisher(row.kind, row.name, row.profile)
            self.ros.wait_for(self.targets.get_subscription_count, 20, "the arm's subscription")
            self.ros.holds_within(lambda: False, 0.3)
        target, stamp_ns = PoseStamped(), time.time_ns() - round(1e9 * age_s)
        target.header.frame_id = frame
        target.header.stamp.sec, target.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        target.pose.position.x, target.pose.position.z = x, z
        target.pose.orientation.x, target.pose.orientation.w = norm, 0.0
        self.targets.publish(target)
        answers = self.heard["/panda/accepted_target"]
        mine = lambda: next((a for a, _ in answers if a.header.stamp == target.header.stamp), None)  # noqa: E731
        return self.ros.wait_for(mine, 10, "an answer to the target")

    def act(self, kind, name, goal):
        """Feedback and the pending result of an accepted goal, with its handle."""
        client, feedback = ActionClient(self.ros.node, kind, name), []
        self.ros.wait_for(client.server_is_ready, 20, f"the server of {name}")
        sent = client.send_goal_async(goal, feedback_callback=lambda message: feedback.append(message.feedback))
        handle = self.ros.result(sent, 20, "an answer to the goal")
        assert handle.accepted
        return handle, feedback, handle.get_result_async()


@pytest.fixture(scope="module", params=["sim", "relay"])
def cell(request, tmp_path_factory):
    sessions = session_in(tmp_path_factory.mktemp(request.param))
    session = next(sessions)
    try:
        yield Cell(session, request.param)
    finally:
        sessions.close()


def stamp_s(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def test_topics_and_services_have_their_owner_type_and_profile(cell):
    node = cell.ros.node
    for name in TOPICS:
        (publisher,) = node.get_publishers_info_by_topic(name)
        row, profile = BY_NAME[name], publisher.qos_profile
        assert (publisher.node_name, publisher.topic_type) == (cell.arm, row.type_name)
        assert (profile.reliability.name.lower(), profile.durability.name.lower()) == (row.reliability, row.durability)
    served = dict(node.get_service_names_and_types_by_node(cell.arm, "/"))
    assert {name: served.get(name) for name in SERVICES} == {name: [BY_NAME[name].type_name] for name in SERVICES}
    asked = {s.node_name for s in node.get_subscriptions_info_by_topic("/panda/target_pose")}
    assert asked == {cell.arm}


def test_streams_have_their_rate_frame_stamps_and_units(cell):
    # What was latched, and what has waited meanwhile, is older.
    cell.ros.holds_within(lambda: False, 1)
    for messages in cell.heard.values():
        messages.clear()
    cell.ros.holds_within(lambda: False, 2)
    for name in ("/panda/current_pose", "/panda/joint_states", "/panda/arm_state", "/dlo/keypoints"):
        messages, row = cell.heard[name], BY_NAME[name]
        stamps = [stamp_s(message) for message, _ in messages]
        rate = (len(stamps) - 1) / (stamps[-1] - stamps[0])
        assert row.hz / 4 < rate < 1.2 * row.hz, f"{name}: {rate} Hz"
        assert stamps == sorted(stamps)
        assert all(message.header.frame_id == row.frame for message, _ in messages)
        ages = [came - stamp_s(message) for message, came in messages]
        assert -0.05 < min(ages) and max(ages) < 0.5, f"{name}: {min(ages)} to {max(ages)} s"
    pose = cell.newest("/panda/current_pose").pose
    q = pose.orientation
    assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1, abs=1e-6)
    # Metres and radians: inside the workspace, and within a turn.
    assert 0.275 < pose.position.x < 0.6 and 0.1 < pose.position.z < 0.5
    joints = cell.newest("/panda/joint_states")
    assert list(joints.name) == [f"panda_joint{i}" for i in range(1, 8)] and all(abs(p) < math.pi for p in joints.position)
    assert cell.state.mode == ArmState.MODE_IDLE and not cell.state.errors and 0 <= cell.state.success_rate <= 1
    assert cell.state.is_sim == (cell.name == "sim")


def test_an_idle_arm_refuses_targets(cell):
    answer = cell.command(*cell.place)
    assert not answer.accepted and "not enabled" in answer.reason


def test_the_gate_lets_good_targets_through_and_names_what_is_wrong_with_others(cell):
    x, z = cell.place
    cell.enable()
    for arguments, part in (
        ({"x": x + 0.15, "z": z}, "from the measured pose"),
        ({"x": math.nan, "z": z}, "not finite"),
        ({"x": x, "z": z, "frame": "world"}, "expected frame panda_link0, got `world`"),
        ({"x": x, "z": z, "age_s": 5.0}, "s old"),
        ({"x": x, "z": z, "norm": 2.0}, "unit norm"),
    ):
        answer = cell.command(**arguments)
        assert not answer.accepted and part in answer.reason, answer.reason
    answer = cell.command(x + 0.03, z - 0.02)
    assert answer.accepted and not answer.clipped_x and not answer.clipped_z, answer.reason
    assert (answer.accepted_count, answer.rejected_count) == (1, 5)
    there = lambda: math.dist(cell.place, (x + 0.03, z - 0.02)) < 0.003  # noqa: E731
    cell.ros.wait_for(there, 5, "the arm at its target")
    cell.enable(False)


def test_hold_and_recovery_answer(cell):
    cell.enable()
    assert cell.ros.call(Trigger, "/panda/hold", Trigger.Request()).success
    cell.wait_mode(ArmState.MODE_HOLD)
    cell.enable(False)
    answer = cell.ros.call(Trigger, "/panda/error_recovery", Trigger.Request())
    assert answer.success or answer.message


def test_compliance_is_checked_and_reaches_whoever_has_gains(cell):
    wanted = SetCompliance.Request(stiffness=[900.0] * 3 + [60.0] * 3, damping=[50.0] * 3 + [5.0] * 3, error_clip=0.015)
    answer = cell.ros.call(SetCompliance, "/panda/set_compliance", wanted)
    assert answer.success, answer.message
    if cell.name == "relay":
        client = AsyncParameterClient(cell.ros.node, "cartesian_impedance_controller")
        cell.ros.wait_for(client.services_are_ready, 20, "the controller's parameters")
        names = ["task.k_pos_x", "task.d_rot_z", "task.error_clip.y"]
        values = cell.ros.result(client.get_parameters(names), 10, "its parameters").values
        assert [value.double_value for value in values] == [900.0, 5.0, 0.015]
    wanted.error_clip = -1.0
    refused = cell.ros.call(SetCompliance, "/panda/set_compliance", wanted)
    assert not refused.success and "error_clip" in refused.message


def test_the_arm_moves_to_the_start_pose_of_the_model(cell):
    _, feedback, answer = cell.act(MoveToStart, "/panda/move_to_start", MoveToStart.Goal())
    result = cell.ros.result(answer, 20, "the start pose")
    assert result.status == GoalStatus.STATUS_SUCCEEDED and result.result.success, result.result.message
    assert cell.place == pytest.approx(START, abs=0.005)
    assert feedback and feedback[-1].distance < 0.05
    cell.wait_mode(ArmState.MODE_IDLE)


@pytest.fixture(scope="module")
def runner(cell):
    """The node that runs episodes. Nobody else may command the arm then."""
    if cell.targets:
        cell.ros.node.destroy_publisher(cell.targets)
        cell.targets = None
    cell.session.node("policy_runner", "-p", f"model_file:={cell.session.root / MODEL}")
    cell.ros.wait_for(lambda: cell.ros.node.count_publishers("/panda/target_pose") == 1, 20, "the runner")
    cell.ros.holds_within(lambda: False, 1)
    return cell


def test_an_episode_is_told_from_start_to_end(runner):
    cell = runner
    for messages in cell.heard.values():
        messages.clear()
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), policy_name="constant", seed=9, run_all_steps=True, max_steps=STEPS)
    _, feedback, answer = cell.act(RunEpisode, "/policy_runner/run_episode", goal)
    result = cell.ros.result(answer, 30, "the episode").result
    assert result.success and len(result.rewards) == STEPS, result.message
    cell.wait_mode(ArmState.MODE_IDLE)
    told = lambda name: [message for message, _ in cell.heard[name]]  # noqa: E731
    cell.ros.wait_for(lambda: len(told("/episode/event")) == 2 and len(told("/policy/observation")) > STEPS, 5, "all that is told")
    started, ended = told("/episode/event")
    assert (started.event, started.episode, started.policy, started.seed) == (EpisodeEvent.STARTED, result.episode, "constant", 9)
    assert (ended.event, ended.reason, ended.steps) == (EpisodeEvent.ENDED, result.end, STEPS)
    assert stamp_s(ended) - stamp_s(started) == pytest.approx(STEPS * started.step_period, abs=0.3)
    assert [a.step for a in told("/policy/action")] == list(range(STEPS))
    assert [o.step for o in told("/policy/observation")] == list(range(STEPS + 1))
    for observation in told("/policy/observation"):
        ages = [stamp_s(observation) - (s.sec + 1e-9 * s.nanosec) for s in (observation.keypoints_stamp, observation.pose_stamp)]
        assert all(0 <= age < 0.16 for age in ages)
    answers = told("/panda/accepted_target")
    assert len(answers) == STEPS and all(a.accepted for a in answers)
    last = answers[-1].pose.position
    assert (last.x, last.z) == pytest.approx([s + 0.06 * STEPS * b for s, b in zip(START, BIAS)], abs=0.005)
    assert math.dist(cell.place, (last.x, last.z)) < 0.005, "the arm is not where the last target was"


def test_a_cancelled_episode_stops_the_arm(runner):
    cell = runner
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), run_all_steps=True)
    handle, feedback, answer = cell.act(RunEpisode, "/policy_runner/run_episode", goal)
    cell.ros.wait_for(lambda: feedback, 20, "a step")
    cell.ros.result(handle.cancel_goal_async(), 10, "an answer to the cancel")
    assert cell.ros.result(answer, 10, "the end").status == GoalStatus.STATUS_CANCELED
    event = lambda: cell.newest("/episode/event")  # noqa: E731
    cell.ros.wait_for(lambda: (event().event, event().reason) == (EpisodeEvent.ENDED, "cancelled"), 5, "the event")
    cell.wait_mode(ArmState.MODE_IDLE)
