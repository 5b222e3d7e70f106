"""One suite for every cell: topics, rates, frames, stamps, units and episodes are the same for whoever commands an arm.

The cells are the simulated one, the bridge that drives an emulated arm over FCI, and the bridge that relays to a controller, here a
stand-in in rclpy. The first two also publish twist, wrench, transforms and images, which a relay cannot know.
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
from geometry_msgs.msg import PoseStamped
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import SetBool, Trigger

from support.contract import BASE, BY_NAME
from support.policy import BIAS, policy_file
from support.ros import Goal
from support.session import given, session_in
from support.stamps import stamp_s
from support.stand_ins import StandIn
from support.waiting import wait_for

TOPICS = ("/panda/current_pose", "/panda/joint_states", "/panda/arm_state", "/panda/accepted_target")
SERVICES = ("/panda/enable", "/panda/hold", "/panda/error_recovery", "/panda/set_compliance")
MODEL = "launch_configs/models/soft_bar.yaml"
START = (0.40, 0.42)
# A long, soft bar, which swings for half a minute.
SOFT = "theta:=[0.27,6000.0]"
STEPS = 3


class Cell:
    """The node that has the arm, and a client of it. The policy runner, which commands the arm, too, is started later."""

    def __init__(self, session, name):
        self.name, self.session = name, session
        model = f"model_file:={session.root / MODEL}"
        if name == "sim":
            self.arm = "simulated_cell"
            session.node(self.arm, *given(model, SOFT, "settle_time_s:=0.2"))
            vision = ("camera", "keypoint_tracker")
            for node in vision:
                session.node(node, "--params-file", session.root / "launch_configs/params/sim.yaml")
            others = vision
        elif name == "emulated":
            self.arm = "panda_bridge"
            # A loopback address of its own, because clients of FCI choose no port.
            address = f"127.44.{session.domain}.1"
            session.node("panda_emulator", "-p", f"address:={address}")
            parameters = ("transport:=fci", f"fci.host:={address}", "is_real:=false", "settle_time_s:=0.2")
            session.node(self.arm, *given(model, *parameters))
            session.node("simulated_cell", *given(model, SOFT, "hand:=elsewhere"))
            vision = ("camera", "keypoint_tracker")
            for node in vision:
                session.node(node, "--params-file", session.root / "launch_configs/params/emulated.yaml")
            others = ("panda_emulator", "simulated_cell", *vision)
        else:
            self.arm, others = "panda_bridge", ("cartesian_impedance_controller",)
            session.node(self.arm, "-p", model, "-p", "settle_time_s:=0.2")
            time.sleep(1)
            session.start_script(sys.executable, session.root / "tests/support/stand_in_lab.py", session.domain, name="lab")
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

    def still_object(self):
        """Stills the object, if it is one that swings."""
        if self.name != "relay":
            self.ros.still_object()

    def enable(self, on=True):
        answer = self.ros.call(SetBool, "/panda/enable", SetBool.Request(data=on))
        assert answer.success, answer.message
        self.wait_mode(ArmState.MODE_HOLD, ArmState.MODE_TRACKING) if on else self.wait_mode(ArmState.MODE_IDLE)

    def command(self, x, z, frame=BASE, age_s=0.0, norm=1.0):
        """Publishes a target; returns the answer of the safety gate."""
        if self.targets is None:
            row = BY_NAME["/panda/target_pose"]
            self.targets = self.ros.node.create_publisher(row.kind, row.name, row.profile)
            self.ros.wait_for(self.targets.get_subscription_count, 20, "the arm's subscription")
            # The arm may match the publisher a little later than the publisher matches the arm.
            self.ros.spin(0.3)
        target, stamp_ns = PoseStamped(), time.time_ns() - round(1e9 * age_s)
        target.header.frame_id = frame
        target.header.stamp.sec, target.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        target.pose.position.x, target.pose.position.z = x, z
        target.pose.orientation.x, target.pose.orientation.w = norm, 0.0
        self.targets.publish(target)
        answers = self.heard["/panda/accepted_target"]
        mine = lambda: next((a for a, _ in answers if a.header.stamp == target.header.stamp), None)
        return self.ros.wait_for(mine, 10, "an answer to the target")


@pytest.fixture(scope="module", params=["sim", "emulated", "relay"])
def cell(request, tmp_path_factory):
    with session_in(tmp_path_factory.mktemp(request.param)) as session:
        yield Cell(session, request.param)


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
    # Drops latched messages and those that waited in queues, which are older than the ages allowed below.
    cell.ros.spin(1)
    for messages in cell.heard.values():
        messages.clear()
    cell.ros.spin(2)
    for name in ("/panda/current_pose", "/panda/joint_states", "/panda/arm_state", "/dlo/keypoints"):
        messages, row = cell.heard[name], BY_NAME[name]
        stamps = [stamp_s(message.header.stamp) for message, _ in messages]
        rate = (len(stamps) - 1) / (stamps[-1] - stamps[0])
        assert row.hz / 4 < rate < 1.2 * row.hz, f"{name}: {rate} Hz"
        assert stamps == sorted(stamps)
        assert all(message.header.frame_id == row.frame for message, _ in messages)
        ages = [came - stamp_s(message.header.stamp) for message, came in messages]
        assert min(ages) > -0.05 and max(ages) < 0.5, f"{name}: {min(ages)} to {max(ages)} s"
    pose = cell.newest("/panda/current_pose").pose
    q = pose.orientation
    assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1, abs=1e-6)
    # Units: metres inside the workspace of the model, and radians within half a turn.
    assert 0.275 < pose.position.x < 0.6 and 0.1 < pose.position.z < 0.5
    joints = cell.newest("/panda/joint_states")
    assert list(joints.name) == [f"panda_joint{i}" for i in range(1, 8)] and all(abs(p) < math.pi for p in joints.position)
    assert cell.state.mode == ArmState.MODE_IDLE and not cell.state.errors and 0 <= cell.state.success_rate <= 1
    assert cell.state.is_sim == (cell.name != "relay")


def test_an_idle_arm_refuses_targets(cell):
    answer = cell.command(*cell.place)
    assert not answer.accepted and "not enabled" in answer.reason


def test_the_gate_lets_good_targets_through_and_names_the_fault_of_others(cell):
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
    there = lambda: math.dist(cell.place, (x + 0.03, z - 0.02)) < 0.003
    cell.ros.wait_for(there, 5, "the arm at its target")
    cell.enable(False)


def target(x, z):
    message, now_ns = PoseStamped(), time.time_ns()
    message.header.frame_id = BASE
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 10**9)
    message.pose.position.x, message.pose.position.z = x, z
    message.pose.orientation.x, message.pose.orientation.w = 1.0, 0.0
    return message


def enable_when_possible(cell):
    """Enables an arm whose last publisher may still be known to it, or that has lost its robot on a busy machine."""
    cell.ros.wait_for(lambda: cell.ros.call(SetBool, "/panda/enable", SetBool.Request(data=True)).success, 20, "an enabled arm")


def ended_by(cell, stranger):
    """Waits until the motion has ended; returns the fault if it names the stranger, and "" if the robot was lost meanwhile."""
    cell.ros.wait_for(lambda: cell.state.mode not in (ArmState.MODE_HOLD, ArmState.MODE_TRACKING), 10, "the end of the motion")
    cell.ros.holds_within(lambda: stranger in cell.state.fault, 3)
    return cell.state.fault if stranger in cell.state.fault else ""


def ends_by_targets_of_a_stranger(cell):
    """Lets a second publisher send targets to an arm that follows another; returns the fault that names both, or "" to try again."""
    x, z = cell.place
    enable_when_possible(cell)
    if not cell.command(x + 0.01, z).accepted:
        return ""
    answers, strange = cell.heard["/panda/accepted_target"], set()
    key = lambda message: (message.header.stamp.sec, message.header.stamp.nanosec)
    with StandIn(cell.session.domain, "lab_policy") as lab:
        publisher = lab.publisher("/panda/target_pose")
        # The arm is sent to as soon as it is seen: the next look at the graph is up to half a second away.
        wait_for(publisher.get_subscription_count, 20, "the arm's subscription", pause=lambda: time.sleep(0.001))
        answered = lambda: {key(answer) for answer, _ in answers} & strange
        for _ in range(200):
            message = target(x + 0.05, z)
            strange.add(key(message))
            publisher.publish(message)
            cell.ros.spin(0.005)
            if len(answered()) >= 20:
                break
        cell.ros.wait_for(answered, 10, "an answer to a target of the stranger")
        fault = ended_by(cell, "/lab_policy (process ")
        assert not cell.command(x + 0.01, z).accepted, "the motion has ended for both"
    taken = [a for a, _ in answers if a.accepted and key(a) in strange]
    assert not taken, f"{len(taken)} targets of the stranger were accepted"
    cell.ros.wait_for(lambda: cell.ros.node.count_publishers("/panda/target_pose") == 1, 20, "the end of the stranger")
    return fault


def test_not_one_target_of_a_second_publisher_is_accepted_and_the_first_ends_the_motion(cell):
    fault = next(filter(None, (ends_by_targets_of_a_stranger(cell) for _ in range(5))), "")
    assert f"/{cell.ros.node.get_name()} (process " in fault, fault
    enable_when_possible(cell)
    cell.enable(False)


def test_a_publisher_that_is_started_again_is_a_stranger_until_the_arm_is_enabled_again(cell):
    def refused():
        x, z = cell.place
        enable_when_possible(cell)
        if not cell.command(x, z).accepted:
            return ""
        cell.ros.node.destroy_publisher(cell.targets)
        cell.targets = None
        # An arm that has lost its robot meanwhile gives another reason.
        answer = cell.command(x, z)
        assert not answer.accepted
        return answer.reason if "came from" in answer.reason else ""

    assert next(filter(None, (refused() for _ in range(5))), "")
    enable_when_possible(cell)
    assert cell.command(*cell.place).accepted
    cell.enable(False)


def test_an_episode_event_of_a_second_node_ends_the_motion(cell):
    row = BY_NAME["/episode/event"]
    own = cell.ros.node.create_publisher(row.kind, row.name, row.profile)
    cell.ros.wait_for(own.get_subscription_count, 20, "the arm's subscription of events")

    def fault():
        enable_when_possible(cell)
        own.publish(EpisodeEvent(event=EpisodeEvent.STARTED, episode=7, step_period=2.0))
        cell.ros.spin(0.5)
        if not cell.command(*cell.place).accepted:
            return ""
        with StandIn(cell.session.domain, "lab_runner") as lab:
            events = lab.publisher("/episode/event")
            cell.ros.wait_for(events.get_subscription_count, 20, "the arm's subscription of the stranger's events")
            # An end would switch the supervision of silence off.
            events.publish(EpisodeEvent(event=EpisodeEvent.ENDED, episode=7))
            return ended_by(cell, "an episode event came from /lab_runner (process ")

    try:
        assert next(filter(None, (fault() for _ in range(5))), "")
    finally:
        own.publish(EpisodeEvent(event=EpisodeEvent.ENDED, episode=7))
        cell.ros.spin(0.5)
        cell.ros.node.destroy_publisher(own)
    enable_when_possible(cell)
    cell.enable(False)


def test_the_arm_can_move_as_soon_as_a_recovery_has_answered(cell):
    if cell.name != "emulated":
        pytest.skip("only the emulated arm has a user stop that this test can press")
    for _ in range(5):
        cell.enable()
        for pressed in (True, False):
            cell.ros.call(SetBool, "/panda_emulator/user_stop", SetBool.Request(data=pressed))
            cell.wait_mode(ArmState.MODE_USER_STOP)
        # The release may be known a little later.
        cell.ros.wait_for(lambda: cell.ros.call(Trigger, "/panda/error_recovery", Trigger.Request()).success, 10, "the recovery")
        result = Goal(cell.ros, MoveToStart, "/panda/move_to_start", MoveToStart.Goal(settle_time=0.1)).result()
        assert result.success, result.message


def test_an_arm_with_closed_brakes_is_not_enabled_and_says_why(cell):
    if cell.name != "emulated":
        pytest.skip("only the emulated arm has brakes that this test can close")
    brakes = lambda are_open: cell.ros.call(SetBool, "/panda_emulator/brakes", SetBool.Request(data=are_open))
    brakes(False)
    try:
        refused = lambda: cell.ros.call(SetBool, "/panda/enable", SetBool.Request(data=True)).message
        cell.ros.wait_for(lambda: "open them in Desk" in refused(), 20, "a refusal that names the brakes")
    finally:
        brakes(True)
    enable_when_possible(cell)
    cell.enable(False)


def test_hold_stops_the_arm_and_recovery_answers(cell):
    cell.enable()
    assert cell.ros.call(Trigger, "/panda/hold", Trigger.Request()).success
    cell.wait_mode(ArmState.MODE_HOLD)
    cell.enable(False)
    answer = cell.ros.call(Trigger, "/panda/error_recovery", Trigger.Request())
    assert answer.success or answer.message


def test_compliance_is_checked_and_reaches_a_controller_with_gains(cell):
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
    if cell.name == "emulated":
        # 2000 N/m times 0.04 m: 80 N, which the gate's own limit allows, and twice the default threshold of a collision.
        hard = SetCompliance.Request(stiffness=[2000.0] * 3 + [150.0] * 3, damping=[89.0] * 3 + [7.0] * 3, error_clip=0.04)
        refused = cell.ros.call(SetCompliance, "/panda/set_compliance", hard)
        assert not refused.success and "80.0 N" in refused.message and "threshold of 40 N" in refused.message, refused.message


def test_the_arm_moves_to_the_start_pose_of_the_model(cell):
    goal = Goal(cell.ros, MoveToStart, "/panda/move_to_start", MoveToStart.Goal())
    result = goal.result()
    assert result.success, result.message
    # A pose of the end may still wait in the queue of a busy machine.
    cell.ros.wait_for(lambda: cell.place == pytest.approx(START, abs=0.005), 10, "the arm at the start")
    assert goal.feedback and goal.feedback[-1].distance < 0.05
    cell.wait_mode(ArmState.MODE_IDLE)


@pytest.fixture(scope="module")
def runner(cell):
    """The cell with a policy runner, which has to be the only one that commands the arm."""
    if cell.targets:
        cell.ros.node.destroy_publisher(cell.targets)
        cell.targets = None
    cell.session.node("policy_runner", "-p", f"model_file:={cell.session.root / MODEL}")
    cell.ros.wait_for(lambda: cell.ros.node.count_publishers("/panda/target_pose") == 1, 20, "the runner")
    # The arm has to know, too, that the other publisher of targets is gone.
    cell.ros.spin(1)
    return cell


def test_the_topics_tell_an_episode_from_start_to_end(runner):
    cell = runner
    cell.still_object()
    for messages in cell.heard.values():
        messages.clear()
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), policy_name="constant", seed=9, run_all_steps=True, max_steps=STEPS)
    result = Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", goal).result()
    assert result.success and len(result.rewards) == STEPS, result.message
    cell.wait_mode(ArmState.MODE_IDLE)
    told = lambda name: [message for message, _ in cell.heard[name]]
    cell.ros.wait_for(lambda: len(told("/episode/event")) == 2 and len(told("/policy/observation")) > STEPS, 5, "all that is told")
    started, ended = told("/episode/event")
    assert (started.event, started.episode, started.policy, started.seed) == (EpisodeEvent.STARTED, result.episode, "constant", 9)
    assert (ended.event, ended.reason, ended.steps) == (EpisodeEvent.ENDED, result.end, STEPS)
    assert stamp_s(ended.header.stamp) - stamp_s(started.header.stamp) == pytest.approx(STEPS * started.step_period, abs=0.3)
    assert [a.step for a in told("/policy/action")] == list(range(STEPS))
    assert [o.step for o in told("/policy/observation")] == list(range(STEPS + 1))
    for observation in told("/policy/observation"):
        at_s = stamp_s(observation.header.stamp)
        ages = [at_s - stamp_s(stamp) for stamp in (observation.keypoints_stamp, observation.pose_stamp)]
        # The runner's parameter max_age_s is 0.15.
        assert all(0 <= age < 0.16 for age in ages)
    answers = told("/panda/accepted_target")
    assert len(answers) == STEPS and all(a.accepted for a in answers)
    last = answers[-1].pose.position
    assert (last.x, last.z) == pytest.approx([s + 0.06 * STEPS * b for s, b in zip(START, BIAS)], abs=0.005)
    assert math.dist(cell.place, (last.x, last.z)) < 0.005, "the arm is not where the last target was"


def test_an_episode_begins_when_the_object_hangs_still(runner):
    cell = runner
    if cell.name == "relay":
        pytest.skip("the stand-in's object does not swing")
    # One fast step, after which the bar swings.
    swing = lambda way: RunEpisode.Goal(policy=array.array("B", policy_file((way, 0.0))), max_steps=1)
    assert Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", swing(0.9)).result().success
    cell.ros.set_parameter("policy_runner", "still_patience_s", 1.5)
    cell.ros.wait_for(lambda: cell.newest("/episode/event").event == EpisodeEvent.ENDED, 5, "the end of the step")
    started = len(cell.heard["/episode/event"])
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), run_all_steps=True, max_steps=STEPS)
    refused = Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", goal).result(GoalStatus.STATUS_ABORTED)
    assert "does not come to rest within 1.5 s" in refused.message and "its keypoints move by" in refused.message, refused.message
    assert len(cell.heard["/episode/event"]) == started and cell.state.mode == ArmState.MODE_IDLE
    cell.ros.set_parameter("policy_runner", "still_patience_s", 60.0)
    waiting = Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", goal)
    assert not waiting.ends_within(2) and len(cell.heard["/episode/event"]) == started
    cell.ros.still_object()
    cell.ros.wait_for(lambda: len(cell.heard["/episode/event"]) > started, 8, "the start of the episode")
    assert waiting.result().success
    assert Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", swing(-0.9)).result().success
    waiting = Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", goal)
    assert not waiting.ends_within(1.5) and cell.state.mode == ArmState.MODE_IDLE
    waiting.cancel()
    assert waiting.result(GoalStatus.STATUS_CANCELED).end == "cancelled"


def test_a_cancelled_episode_stops_the_arm(runner):
    cell = runner
    cell.still_object()
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), run_all_steps=True)
    run = Goal(cell.ros, RunEpisode, "/policy_runner/run_episode", goal)
    run.wait_feedback()
    run.cancel()
    run.result(GoalStatus.STATUS_CANCELED)
    event = lambda: cell.newest("/episode/event")
    cell.ros.wait_for(lambda: (event().event, event().reason) == (EpisodeEvent.ENDED, "cancelled"), 5, "the event")
    cell.wait_mode(ArmState.MODE_IDLE)
