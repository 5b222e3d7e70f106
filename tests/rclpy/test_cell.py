"""The graph on a simulated cell beside rclpy: topics, services, actions, parameters and logs of its nodes."""

import array
import math
import time

import pytest
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from catenary_msgs.action import FindEffects, Infer, MoveToStart, RunEpisode, Train
from catenary_msgs.msg import EpisodeEvent
from catenary_msgs.srv import CloseEnvs, OpenEnvs, SetCompliance, Simulate, StepEnvs
from rcl_interfaces.msg import Log, ParameterEvent, ParameterType
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_srvs.srv import SetBool, Trigger

from support.contract import ACTIONS, BASE, BY_NAME, CELL, NODES, OPTICAL, REPLIES, RUNNER, SERVICES, TOPICS
from support.policy import policy_file
from support.program import BAG, MODEL
from support.ros import Goal, Ros
from support.stamps import stamp_s

IMAGE = "/camera/camera/color/image_raw"
STEPS = 3


def profile_words(profile):
    return profile.reliability.name.lower(), profile.durability.name.lower()


def send(graph, name, goal):
    """Sends a goal to the action of this name."""
    return Goal(graph.ros, BY_NAME[name].kind, name, goal)


# Topics


@pytest.fixture(scope="module")
def heard(graph):
    """Messages of every topic with their time of arrival (s), during an episode and an inference; and the results of both."""
    messages = {row.name: [] for row in TOPICS}

    def keep(name):
        return lambda message: messages[name].append((message, time.time()))

    # Decoding all images in Python would delay the other messages, so only the newest is kept, undecoded.
    latest_image = lambda data: messages[IMAGE].__setitem__(slice(None), [(data, time.time())])
    subscriptions = []
    for row in TOPICS:
        raw, profile = row.name == IMAGE, row.profile_of_depth(max(row.depth, 100))
        heard_by = latest_image if raw else keep(row.name)
        subscriptions.append(graph.ros.node.create_subscription(row.kind, row.name, heard_by, profile, raw=raw))
    # A change of a parameter is logged, so that /rosout has a message.
    graph.ros.set_parameter(RUNNER, "patience_s", 1.0)
    send(graph, "/panda/move_to_start", MoveToStart.Goal(settle_time=0.5)).result()
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), policy_name="constant", seed=3, run_all_steps=True, max_steps=STEPS)
    run = send(graph, "/policy_runner/run_episode", goal)
    result = run.result()
    assert result.success and len(result.rewards) == STEPS
    infer = Infer.Goal(source=Infer.Goal.SOURCE_LIVE, model_yaml=MODEL.read_text(), preset="networks", iterations=1, simulations=20)
    inferred = send(graph, "/bayes_sim/infer", infer).result()
    graph.ros.spin(0.3)
    for subscription in subscriptions:
        graph.ros.node.destroy_subscription(subscription)
    messages[IMAGE] = [(deserialize_message(data, BY_NAME[IMAGE].kind), came_s) for data, came_s in messages[IMAGE]]
    return messages, result, inferred


@pytest.mark.parametrize("row", [row for row in TOPICS if row.publishers], ids=lambda row: row.name)
def test_node_to_rclpy(graph, heard, row):
    found = graph.ros.node.get_publishers_info_by_topic(row.name)
    ours = [publisher for publisher in found if publisher.node_name in NODES]
    assert {publisher.node_name for publisher in ours} == set(row.publishers)
    for publisher in ours:
        assert (publisher.topic_type, publisher.node_namespace) == (row.type_name, "/")
        assert profile_words(publisher.qos_profile) == (row.reliability, row.durability)
    messages = heard[0][row.name]
    assert messages
    for message, came_s in messages:
        if row.frame:
            assert message.header.frame_id == row.frame
        # Latched messages may be older.
        if hasattr(message, "header") and row.durability == "volatile":
            assert -0.05 < came_s - stamp_s(message.header.stamp) < 2


@pytest.mark.parametrize("row", [row for row in TOPICS if row.subscribers], ids=lambda row: row.name)
def test_rclpy_to_node(graph, row):
    found = graph.ros.node.get_subscriptions_info_by_topic(row.name)
    ours = [subscription for subscription in found if subscription.node_name in NODES]
    assert {subscription.node_name for subscription in ours} == set(row.subscribers)
    for subscription in ours:
        assert (subscription.topic_type, profile_words(subscription.qos_profile)) == (row.type_name, (row.reliability, row.durability))


def test_there_is_no_other_topic(graph):
    named = {name for name, _ in graph.ros.node.get_topic_names_and_types() if "/_action/" not in name}
    # This graph uses the time of the system, so no node has an endpoint on /clock.
    assert named - {"/parameter_events"} == {row.name for row in TOPICS if row.name != "/clock"} | set(REPLIES)


def test_types_are_those_of_the_contract(graph):
    types = dict(graph.ros.node.get_topic_names_and_types())
    wrong = {row.name for row in TOPICS if row.publishers and types[row.name] != [row.type_name]}
    assert not wrong


@pytest.mark.parametrize("row", [row for row in TOPICS if row.hz and row.name != IMAGE], ids=lambda row: row.name)
def test_streams_keep_their_pace(heard, row):
    stamps = [stamp_s((m.transforms[0] if hasattr(m, "transforms") else m).header.stamp) for m, _ in heard[0][row.name]]
    assert stamps == sorted(stamps)
    # A busy machine loses some messages, but no message comes twice.
    rate = len(stamps) / (stamps[-1] - stamps[0])
    assert row.hz / 4 < rate < 1.1 * row.hz


def test_the_topics_tell_an_episode_step_by_step(heard):
    messages, result, _ = heard
    only = lambda name: [message for message, _ in messages[name]]
    actions, observations = only("/policy/action"), only("/policy/observation")
    assert [a.step for a in actions] == list(range(STEPS)) and [o.step for o in observations] == list(range(STEPS + 1))
    started, ended = only("/episode/event")[-2:]
    assert (started.event, started.policy, started.seed) == (EpisodeEvent.STARTED, "constant", 3)
    assert (ended.event, ended.steps, ended.episode) == (EpisodeEvent.ENDED, STEPS, result.episode)
    assert ended.episode_return == pytest.approx(result.episode_return)
    targets, answers = only("/panda/target_pose"), only("/panda/accepted_target")
    assert [a.header.stamp for a in answers] == [t.header.stamp for t in targets] and all(a.accepted for a in answers)


def test_transforms_agree_with_the_poses(heard):
    messages = heard[0]
    poses = {stamp_s(m.header.stamp): m.pose for m, _ in messages["/panda/current_pose"]}
    both = 0
    for message, _ in messages["/tf"]:
        (hand,) = message.transforms
        assert (hand.header.frame_id, hand.child_frame_id) == (BASE, "panda_hand_tcp")
        if pose := poses.get(stamp_s(hand.header.stamp)):
            both += 1
            moved, turned = hand.transform.translation, hand.transform.rotation
            assert (moved.x, moved.y, moved.z) == (pose.position.x, pose.position.y, pose.position.z)
            assert (turned.x, turned.y, turned.z, turned.w) == (
                pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w
            )  # fmt: skip
    assert both > 50
    (camera,) = messages["/tf_static"][0][0].transforms
    assert (camera.header.frame_id, camera.child_frame_id) == (BASE, OPTICAL)
    turned = camera.transform.rotation
    assert math.hypot(turned.x, turned.y, turned.z, turned.w) == pytest.approx(1)


def test_images_have_the_size_of_the_camera_info(heard):
    messages = heard[0]
    info, image = messages["/camera/camera/color/camera_info"][-1][0], messages["/camera/camera/color/image_raw"][-1][0]
    assert (image.width, image.height, image.encoding, image.step) == (640, 480, "rgb8", 1920)
    assert (info.width, info.height) == (640, 480) and len(image.data) == 640 * 480 * 3
    assert info.k[8] == 1 and 0 < info.k[2] < 640 and 0 < info.k[5] < 480
    mask = messages["/dlo/mask"][-1][0]
    assert (mask.width, mask.height, mask.encoding) == (256, 256, "mono8") and set(mask.data) <= {0, 1, 2}


def test_every_node_reports_diagnostics(heard):
    found = {}
    for message, _ in heard[0]["/diagnostics"]:
        for status in message.status:
            found[status.name] = {value.key: value.value for value in status.values}
            assert status.level in (b"\0", b"\1", b"\2") and status.message
    assert set(found) == {f"/{node}" for node in NODES}
    assert all(1 < float(values["resident_memory_mb"]) < 2000 for values in found.values())


def test_an_idle_graph_has_no_error(graph):
    """Warnings are allowed: on a busy machine messages may be late for a moment."""
    kind, newest = BY_NAME["/diagnostics"].kind, {}
    reports = graph.ros.node.create_subscription(kind, "/diagnostics", lambda m: newest.update((s.name, s) for s in m.status), 100)
    well = lambda: len(newest) == len(NODES) and all(status.level in (b"\0", b"\1") for status in newest.values())
    assert graph.ros.holds_within(well, 30), newest
    graph.ros.node.destroy_subscription(reports)


# Late joiners and profiles that do not fit


def test_late_joiners_get_latched_messages(graph, heard):
    late = Ros(graph.domain, "late")
    rows = [BY_NAME[name] for name in ("/episode/event", "/bayes_sim/posterior", "/panda/arm_state", "/tf_static")]
    got = {row.name: [] for row in rows}
    for row in rows:
        late.node.create_subscription(row.kind, row.name, got[row.name].append, row.profile)
    late.wait_for(lambda: all(got.values()) and len(got["/episode/event"]) >= 2, 20, "the latched messages")
    early = {row.name: [message for message, _ in heard[0][row.name]] for row in rows}
    assert got["/episode/event"] == early["/episode/event"][-len(got["/episode/event"]) :]
    assert got["/bayes_sim/posterior"] == early["/bayes_sim/posterior"][-1:] == [heard[2].posterior]
    assert got["/tf_static"] == early["/tf_static"]
    late.close()


def test_profiles_that_do_not_fit_are_reported_on_both_sides(graph):
    asked, offered, messages = [], [], []
    node = graph.ros.node
    reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    subscription = node.create_subscription(
        BY_NAME["/panda/current_pose"].kind, "/panda/current_pose", messages.append, reliable,
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=asked.append),
    )  # fmt: skip
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    events = PublisherEventCallbacks(incompatible_qos=offered.append)
    publisher = node.create_publisher(EpisodeEvent, "/episode/event", best_effort, event_callbacks=events)
    graph.ros.wait_for(lambda: asked and offered, 20, "rclpy's events")
    assert not messages
    text = lambda name: graph.text(f"log/{name}.log")
    graph.ros.wait_for(lambda: "QoS mismatch" in text(CELL), 10, "a word of the publishing node")
    node.destroy_subscription(subscription)
    node.destroy_publisher(publisher)


# Services


def call(graph, name, request):
    return graph.ros.call(BY_NAME[name].kind, name, request)


def envs_of_rclpy(graph):
    """Opens one environment, steps it and closes it."""
    domains = [0.25, 1e4]
    request = OpenEnvs.Request(model_yaml=MODEL.read_text(), count=1, domains=domains, fidelity=Simulate.Request.FIDELITY_FAST, seed=1)
    opened = call(graph, "/simulator_pool/open_envs", request)
    assert opened.success and len(opened.observations) == 12, opened.message
    stepped = call(graph, "/simulator_pool/step_envs", StepEnvs.Request(handle=opened.handle, actions=[0.02, -0.01]))
    assert stepped.success and len(stepped.rewards) == 1 and len(stepped.observations) == 12, stepped.message
    # The first observation is x of the end effector, which follows the action of 0.02 m.
    assert 0.005 < stepped.observations[0] - opened.observations[0] < 0.025
    refused = call(graph, "/simulator_pool/step_envs", StepEnvs.Request(handle=opened.handle, actions=[0.02]))
    assert not refused.success and refused.message
    closed = call(graph, "/simulator_pool/close_envs", CloseEnvs.Request(handle=opened.handle))
    assert closed.success, closed.message
    again = call(graph, "/simulator_pool/close_envs", CloseEnvs.Request(handle=opened.handle))
    assert not again.success and str(opened.handle) in again.message


def simulate_of_rclpy(graph):
    request = Simulate.Request(model_yaml=MODEL.read_text(), theta=[0.25, 1e4], drive=Simulate.Request.DRIVE_GRIP, frame_times=[0.0, 0.5])
    grip = request.grip
    grip.time, grip.x, grip.z, grip.pitch = [0.0, 0.5], [0.40, 0.42], [0.42, 0.42], [0.0, 0.0]
    answer = call(graph, "/simulator_pool/simulate", request)
    (track,) = answer.tracks
    assert answer.success and list(track.time) == [0.0, 0.5] and len(track.dlo) == 16
    request.theta = [0.25]
    refused = call(graph, "/simulator_pool/simulate", request)
    assert not refused.success and "theta" in refused.message


def enable_of_rclpy(graph):
    assert call(graph, "/panda/enable", SetBool.Request(data=True)).success
    assert call(graph, "/panda/enable", SetBool.Request(data=False)).success


def hold_of_rclpy(graph):
    assert call(graph, "/panda/enable", SetBool.Request(data=True)).success
    assert call(graph, "/panda/hold", Trigger.Request()).success
    assert call(graph, "/panda/enable", SetBool.Request(data=False)).success


def recovery_of_rclpy(graph):
    answer = call(graph, "/panda/error_recovery", Trigger.Request())
    assert answer.success or answer.message


def compliance_of_rclpy(graph):
    good = SetCompliance.Request(stiffness=[500.0] * 3 + [30.0] * 3, damping=[40.0] * 3 + [5.0] * 3, error_clip=0.02)
    answer = call(graph, "/panda/set_compliance", good)
    assert answer.success and "time constant" in answer.message
    good.stiffness[1] = -1.0
    refused = call(graph, "/panda/set_compliance", good)
    assert not refused.success and "stiffness[1]" in refused.message and "-1" in refused.message


CALLS = {
    "/panda/enable": enable_of_rclpy,
    "/panda/hold": hold_of_rclpy,
    "/panda/error_recovery": recovery_of_rclpy,
    "/panda/set_compliance": compliance_of_rclpy,
    "/simulator_pool/simulate": simulate_of_rclpy,
    "/simulator_pool/open_envs": envs_of_rclpy,
    "/simulator_pool/step_envs": envs_of_rclpy,
    "/simulator_pool/close_envs": envs_of_rclpy,
}


@pytest.mark.parametrize("name", [row.name for row in SERVICES])
def test_rclpy_to_node_calls(graph, name):
    row = BY_NAME[name]
    offered = dict(graph.ros.node.get_service_names_and_types_by_node(row.server, "/"))
    assert offered[name] == [row.type_name]
    CALLS[name](graph)


def test_two_clients_at_once_get_their_own_answers(graph):
    others = [Ros(graph.domain, f"client_{i}") for i in range(2)]
    names, clients = ("max_age_s", "patience_s"), []
    for ros in others:
        client = AsyncParameterClient(ros.node, RUNNER)
        ros.wait_for(client.services_are_ready, 20, "the parameter services")
        clients.append(client)
    for _ in range(10):
        # Ten requests in flight before the first answer is taken, as many as services keep.
        futures = [[client.get_parameters([name]) for _ in range(5)] for client, name in zip(clients, names)]
        for ros, mine in zip(others, futures):
            ros.wait_for(lambda mine=mine: all(f.done() for f in mine), 20, "all answers")
        assert [{f.result().values[0].double_value for f in mine} for mine in futures] == [{0.15}, {1.0}]
    for ros in others:
        ros.close()


# Actions


def offered_actions(graph, node):
    return dict(get_action_server_names_and_types_by_node(graph.ros.node, node, "/"))


def move(x, z, settle=0.0):
    goal = MoveToStart.Goal(use_pose=True, settle_time=settle)
    goal.pose.position.x, goal.pose.position.z = x, z
    goal.pose.orientation.x, goal.pose.orientation.w = 1.0, 0.0
    return goal


def move_of_rclpy(graph):
    name = "/panda/move_to_start"
    send(graph, name, MoveToStart.Goal(settle_time=0.1)).result()
    lines = graph.ros.listen_log()
    rejected = send(graph, name, MoveToStart.Goal(settle_time=100.0))
    assert not rejected.handle.accepted
    # The action protocol has no field for the reason of a rejection.
    said = lambda: [line for line in lines if "expected 0 to 60 s, got 100" in line.msg]
    graph.ros.wait_for(said, 10, "the reason on /rosout")
    assert said()[0].name == CELL
    there = send(graph, name, move(0.45, 0.42))
    there.wait_feedback()
    second = send(graph, name, move(0.40, 0.42))
    assert not second.handle.accepted, "two goals move one arm"
    result = there.result()
    assert result.success and result.pose.position.x == pytest.approx(0.45, abs=0.01)
    distances = [feedback.distance for feedback in there.feedback]
    assert 0 < distances[0] < 0.06 and distances[-1] < distances[0]
    back = send(graph, name, move(0.36, 0.42))
    back.wait_feedback()
    assert back.cancel().return_code == CancelGoal.Response.ERROR_NONE
    stopped = back.result(GoalStatus.STATUS_CANCELED)
    assert not stopped.success and stopped.message == "cancelled" and 0.36 < stopped.pose.position.x < 0.46
    assert back.cancel().return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
    send(graph, name, MoveToStart.Goal(settle_time=0.1)).result()


def episode_of_rclpy(graph):
    bad = send(graph, "/policy_runner/run_episode", RunEpisode.Goal(policy=array.array("B", b"none")))
    assert "policy" in bad.result(GoalStatus.STATUS_ABORTED).message
    graph.ros.still_object()
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), run_all_steps=True)
    episode = send(graph, "/policy_runner/run_episode", goal)
    episode.wait_feedback()
    episode.cancel()
    result = episode.result(GoalStatus.STATUS_CANCELED)
    assert not result.success and result.end == "cancelled" and len(result.rewards) >= 1
    steps = [feedback.step for feedback in episode.steps]
    assert steps == sorted(set(steps))


def infer_of_rclpy(graph):
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=["/nowhere"], model_yaml=MODEL.read_text())
    assert "/nowhere" in send(graph, "/bayes_sim/infer", goal).result(GoalStatus.STATUS_ABORTED).message
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=MODEL.read_text(), preset="networks")
    goal.iterations, goal.simulations = 10, 40
    running = send(graph, "/bayes_sim/infer", goal)
    running.wait_feedback()
    assert running.feedback[0].iterations == 10 and running.feedback[0].posterior.weights
    running.cancel()
    assert running.result(GoalStatus.STATUS_CANCELED).message == "cancelled"


def train_of_rclpy(graph):
    bad = send(graph, "/ppo_trainer/train", Train.Goal(model_yaml="version: 1\nnam: x"))
    assert "nam" in bad.result(GoalStatus.STATUS_ABORTED).message
    goal = Train.Goal(model_yaml=MODEL.read_text(), total_steps=10_000_000, environments=1, fidelity=Simulate.Request.FIDELITY_FAST)
    running = send(graph, "/ppo_trainer/train", goal)
    running.wait_feedback()
    assert running.feedback[0].total_steps == 10_000_000
    assert running.cancel().return_code == CancelGoal.Response.ERROR_NONE
    result = running.result(GoalStatus.STATUS_CANCELED)
    # Much larger than a packet of Ethernet; with launch_configs/fastdds_localhost.xml RustDDS sends it as one datagram.
    assert len(result.policy) > 10_000 and b"catenary policy 2" in bytes(result.policy)


def find_of_rclpy(graph):
    bad = send(graph, "/effect_finder/find", FindEffects.Goal(bags=["/nowhere"], model_yaml=MODEL.read_text()))
    assert "/nowhere" in bad.result(GoalStatus.STATUS_ABORTED).message
    goal = FindEffects.Goal(bags=[str(BAG)], model_yaml=MODEL.read_text(), seed=5)
    running = send(graph, "/effect_finder/find", goal)
    graph.ros.wait_for(lambda: any(f.conclusion for f in running.feedback), running.seconds, "a conclusion")
    first = next(f for f in running.feedback if f.conclusion)
    assert first.stage == "calibrate" and "RMSE" in first.conclusion and 0 <= first.progress <= 1
    running.cancel()
    assert running.result(GoalStatus.STATUS_CANCELED).message == "cancelled"


GOALS = {
    "/panda/move_to_start": move_of_rclpy,
    "/policy_runner/run_episode": episode_of_rclpy,
    "/bayes_sim/infer": infer_of_rclpy,
    "/ppo_trainer/train": train_of_rclpy,
    "/effect_finder/find": find_of_rclpy,
}


@pytest.mark.parametrize("name", [row.name for row in ACTIONS if row.server])
def test_rclpy_to_node_goals(graph, heard, name):
    row = BY_NAME[name]
    assert offered_actions(graph, row.server)[name] == [row.type_name]
    GOALS[name](graph)


def test_there_is_no_other_action(graph):
    served = {name for node in NODES for name in offered_actions(graph, node)}
    assert served == {row.name for row in ACTIONS if row.server}


# Parameters and logs

# For a node: a parameter that may change at run time, another value, a value out of its range, and the range in the message.
CHANGES = {
    "simulated_cell": ("settle_time_s", 0.75, -1.0, "0 to 60"),
    "policy_runner": ("patience_s", 1.5, 100.0, "0 to 60"),
    "simulator_pool": ("workers", 1, 5000, "0 to 1024"),
}
# For a node: a parameter that is read at the start only.
FIXED = {"simulated_cell": "seed", "camera": "dlo.min_saturation", "keypoint_tracker": "fractions"}


@pytest.mark.parametrize("node", NODES)
def test_rclpy_to_node_parameters(graph, node):
    ros, client = graph.ros, AsyncParameterClient(graph.ros.node, node)
    ros.wait_for(client.services_are_ready, 20, "the parameter services")
    ask = lambda future: ros.result(future, 20, "an answer")
    names = ask(client.list_parameters()).result.names
    assert names == sorted(names) and "use_sim_time" in names
    types = ask(client.get_parameter_types(names)).types
    values = ask(client.get_parameters(names)).values
    assert [value.type for value in values] == list(types) and ParameterType.PARAMETER_NOT_SET not in types
    described = ask(client.describe_parameters(names)).descriptors
    assert [d.name for d in described] == names and [d.type for d in described] == list(types)
    assert all(d.description for d in described)
    put = lambda name, value: ask(client.set_parameters([Parameter(name, value=value)])).results[0]
    unknown = put("no_such_thing", 1)
    assert not unknown.successful and "no_such_thing" in unknown.reason and node in unknown.reason
    wrong = put("use_sim_time", "soon")
    assert not wrong.successful and "use_sim_time" in wrong.reason and "boolean" in wrong.reason
    if node in FIXED:
        index = names.index(FIXED[node])
        fixed = put(FIXED[node], value_of(FIXED[node], values[index]))
        assert not fixed.successful and "read-only" in fixed.reason and described[index].read_only
    if node in CHANGES:
        change(ros, client, ask, put, node)


def value_of(name, message):
    return Parameter.from_parameter_msg(ParameterMessage(name=name, value=message)).value


def change(ros, client, ask, put, node):
    """Sets a parameter and sets it back; checks refusals, the event of the change and the log."""
    name, other, beyond, said = CHANGES[node]
    events, lines = [], ros.listen_log()
    subscription = ros.node.create_subscription(ParameterEvent, "/parameter_events", events.append, QoSProfile(depth=100))
    current = lambda: value_of(name, ask(client.get_parameters([name])).values[0])
    first = current()
    refused = put(name, beyond)
    assert not refused.successful and said in refused.reason and name in refused.reason
    both = [Parameter(name, value=other), Parameter("no_such_thing", value=1)]
    assert not ask(client.set_parameters_atomically(both)).result.successful
    assert current() == first, "half of an atomic change was made"
    ros.wait_for(lambda: ros.node.count_publishers("/parameter_events") > 1, 10, "the nodes' events")
    assert put(name, other).successful and current() == other
    mine = lambda: [e for e in events if e.node == f"/{node}" and e.changed_parameters]
    ros.wait_for(mine, 10, "an event")
    assert [p.name for p in mine()[0].changed_parameters] == [name]
    assert put(name, first).successful
    told = lambda: [line for line in lines if line.name == node and f"parameter {name} is now" in line.msg]
    ros.wait_for(lambda: len(told()) >= 2, 10, "the log of both changes")
    assert all(line.level == Log.INFO for line in told())
    assert all(line.file.endswith(".rs") and line.line > 0 and line.stamp.sec > 0 for line in told())
    ros.node.destroy_subscription(subscription)


def test_rosout_keeps_lines_for_late_joiners(graph):
    late = Ros(graph.domain, "late_listener")
    lines = late.listen_log()
    late.wait_for(lambda: any("parameter patience_s is now" in line.msg for line in lines), 10, "a line from before")
    late.close()


def test_nodes_are_in_the_root_namespace_and_publish_their_topics(graph):
    found = {(name, space) for name, space in graph.ros.node.get_node_names_and_namespaces() if name in NODES}
    assert found == {(name, "/") for name in NODES}
    for row in (row for row in TOPICS if row.publishers):
        for node in row.publishers:
            assert row.name in dict(graph.ros.node.get_publisher_names_and_types_by_node(node, "/")), (row.name, node)
