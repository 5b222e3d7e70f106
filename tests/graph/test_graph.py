"""The graph on a simulated cell, beside rclpy: topics, parameters, services, an episode and its recording."""

import array
import json
import math
import signal
import time

import pytest
from action_msgs.msg import GoalStatus
from catenary_msgs.action import Infer, MoveToStart, RunEpisode
from catenary_msgs.msg import ArmState, EefDelta, EpisodeEvent, Keypoints, Mixture
from catenary_msgs.srv import Simulate
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML
from std_srvs.srv import SetBool

from support.contract import TOPICS
from support.policy import BIAS, STEPS, policy_file
from support.program import MODEL
from support.ros import Goal
from support.rosidl import type_hashes
from support.stamps import stamp_s

# Topics that the recorder takes by default.
CONTRACT = {t.name: t for t in TOPICS if t.name not in ("/clock", "/camera/camera/color/image_raw")}
# Largest action of a step, `MAX_DELTA_M` of nodes/method/core.
MAX_DELTA_M = 0.06


def scaled(message):
    """Keypoints (u, v) in the image scaled to [-1, 1]."""
    half = message.image_width / 2, message.image_height / 2
    return [(u / half[0] - 1, v / half[1] - 1) for u, v in zip(message.dlo_u, message.dlo_v)]


def test_keypoints_stream_at_thirty_hertz_or_more(graph):
    messages = graph.ros.listen(Keypoints, "/dlo/keypoints")
    graph.ros.wait_for(lambda: messages, 20, "keypoints")
    (publisher,) = graph.ros.node.get_publishers_info_by_topic("/dlo/keypoints")
    assert (publisher.node_name, publisher.topic_type) == ("keypoint_tracker", "catenary_msgs/msg/Keypoints")

    def rate_of_the_last_three_seconds():
        stamps = [stamp_s(m.header.stamp) for m in messages]
        recent = [stamp for stamp in stamps if stamps[-1] - stamp <= 3]
        return len(recent) / 3 if stamps[-1] - stamps[0] >= 3 else 0

    graph.ros.wait_for(lambda: rate_of_the_last_three_seconds() >= 30, 40, "keypoints at 30 Hz for 3 s")
    stamps = [stamp_s(m.header.stamp) for m in messages]
    assert stamps == sorted(set(stamps)), "a stamp came twice or late"
    for message in messages:
        assert message.header.frame_id and message.target_seen
        assert all(-1 <= c <= 1 for point in scaled(message) for c in point)
        assert all(0 < score <= 1 for score in message.dlo_scores)
    # The four points of a hanging bar spread over the height of the image.
    heights = [v for _, v in scaled(messages[-1])]
    assert max(heights) - min(heights) > 0.1


def test_a_parameter_is_listed_read_set_and_checked(graph):
    client = AsyncParameterClient(graph.ros.node, "policy_runner")
    graph.ros.wait_for(client.services_are_ready, 20, "the parameter services")
    listed = graph.ros.result(client.list_parameters(), 20, "the list of parameters").result.names
    assert {"max_age_s", "patience_s", "model_file", "use_sim_time"} <= set(listed)

    def value():
        (read,) = graph.ros.result(client.get_parameters(["max_age_s"]), 20, "a parameter").values
        assert read.type == ParameterType.PARAMETER_DOUBLE
        return read.double_value

    def put(name, value):
        future = client.set_parameters([Parameter(name, value=value)])
        (answer,) = graph.ros.result(future, 20, "an answer").results
        return answer

    assert value() == 0.15
    assert put("max_age_s", 0.2).successful and value() == 0.2
    for wrong, part in ((-1.0, "0.001 to 10"), (math.nan, "finite"), ("soon", "a number")):
        answer = put("max_age_s", wrong)
        assert not answer.successful and part in answer.reason, answer.reason
    unknown = put("max_age", 1.0)
    assert not unknown.successful and "no parameter max_age" in unknown.reason, unknown.reason
    assert value() == 0.2
    assert put("max_age_s", 0.15).successful


def test_the_arm_is_enabled_and_disabled(graph):
    states = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.ros.node.create_subscription(ArmState, "/panda/arm_state", states.append, latched)
    for data, modes in ((True, (ArmState.MODE_TRACKING, ArmState.MODE_HOLD)), (False, (ArmState.MODE_IDLE,))):
        is_in = lambda modes=modes: states and states[-1].mode in modes
        answer = graph.ros.call(SetBool, "/panda/enable", SetBool.Request(data=data))
        assert answer.success, answer.message
        graph.ros.wait_for(is_in, 20, f"a mode of {modes}")
        assert states[-1].is_sim


def simulate(graph, **changes):
    """Asks the pool for two bars on a short path; returns the frame times and the answer."""
    # Few frames: RustDDS garbles answers of more than 64 kB to clients on Fast DDS (launch_configs/README.md).
    frames = [0.0, 1.0, 2.0]
    request = Simulate.Request(
        model_yaml=MODEL.read_text(),
        theta=[0.25, 2e3, 0.25, 4e4],
        drive=Simulate.Request.DRIVE_GRIP,
        frame_times=frames,
        seed=7,
    )
    grip = request.grip
    grip.time, grip.x, grip.z, grip.pitch = [0.0, 1.0, 2.0], [0.40, 0.44, 0.44], [0.42, 0.42, 0.42], [0.0, 0.0, 0.0]
    for name, value in changes.items():
        setattr(request, name, value)
    return frames, graph.ros.call(Simulate, "/simulator_pool/simulate", request, 60)


def test_two_bars_are_simulated_and_the_softer_one_hangs_lower(graph):
    frames, answer = simulate(graph)
    assert answer.success, answer.message
    soft, stiff = answer.tracks
    assert list(answer.theta_low) == [0.01, 10.0] and list(answer.theta_high) == [10.0, 1e12], "the ranges of length and modulus"
    for track in answer.tracks:
        assert list(track.time) == frames and len(track.dlo) == len(frames) * 8
        assert all(math.isfinite(value) and -1.5 < value < 1.5 for value in track.dlo)
        assert track.eef[0] == pytest.approx(0.40, abs=1e-3) and track.eef[-3] == pytest.approx(0.44, abs=1e-3)
    depth = [max(track.dlo[1:8:2]) for track in (soft, stiff)], [min(track.dlo[1:8:2]) for track in (soft, stiff)]
    span = [high - low for high, low in zip(*depth)]
    assert span[0] > span[1] + 0.02, "the softer bar does not stretch"
    again = simulate(graph)[1]
    assert again.tracks == answer.tracks, "the same request gave other bits"


def test_an_invalid_request_is_answered_with_the_reason(graph):
    assert not (answer := simulate(graph, theta=[0.25])[1]).success
    assert "theta" in answer.message
    assert not (answer := simulate(graph, model_yaml="version: 1\nnam: x")[1]).success
    assert "nam" in answer.message and "line 2" in answer.message


@pytest.fixture(scope="module")
def episode(graph):
    """Result, feedback and bag of an episode of the constant policy from the start pose."""
    bag = graph.folder / "bag"
    recorder = graph.start("record", "--out", bag, "--json")
    graph.wait_for(bag.exists, 30, "the recorder's bag")
    # The publishers discover the recorder during the move to the start and the 2 s there.
    moved = Goal(graph.ros, MoveToStart, "/panda/move_to_start", MoveToStart.Goal(settle_time=2.0)).result()
    assert moved.success and (moved.pose.position.x, moved.pose.position.z) == pytest.approx((0.40, 0.42), abs=0.005)
    policy = array.array("B", policy_file())
    goal = RunEpisode.Goal(policy=policy, policy_name="constant", seed=3, run_all_steps=True)
    run = Goal(graph.ros, RunEpisode, "/policy_runner/run_episode", goal, seconds=60)
    result = run.result()
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(20) == 0
    return result, run.steps, bag


def test_an_episode_runs_to_its_end_with_feedback(episode):
    result, feedback, _ = episode
    assert result.success and result.end in ("step_limit", "success")
    assert len(result.rewards) == STEPS and all(-1 <= reward <= 1 for reward in result.rewards)
    assert result.episode_return == pytest.approx(sum(result.rewards))
    # The first feedback may be sent before its reader is known.
    steps = [f.step for f in feedback]
    assert steps == sorted(set(steps)) and steps[-1] == STEPS - 1 and len(steps) >= STEPS - 2
    assert [result.rewards[f.step] for f in feedback] == [f.reward for f in feedback]


def test_the_recording_holds_the_contract_and_the_episode(episode):
    result, _, bag = episode
    topics = {}
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            topics.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
    assert kinds == {name: row.type_name for name, row in CONTRACT.items()}

    started, ended = topics["/episode/event"]
    assert (started.event, started.policy, started.seed, started.step_period) == (EpisodeEvent.STARTED, "constant", 3, 0.5)
    assert (ended.event, ended.reason, ended.steps) == (EpisodeEvent.ENDED, result.end, STEPS)
    assert started.episode == ended.episode == result.episode

    actions, observations = topics["/policy/action"], topics["/policy/observation"]
    assert [action.step for action in actions] == list(range(STEPS))
    assert [observation.step for observation in observations] == list(range(STEPS + 1))
    for action in actions:
        assert (action.dx, action.dz) == pytest.approx([MAX_DELTA_M * bias for bias in BIAS])
    for observation in observations:
        assert all(-1 <= value <= 1 for value in observation.values)
    targets, accepted = topics["/panda/target_pose"], topics["/panda/accepted_target"]
    assert len(targets) == len(accepted) == STEPS and all(a.accepted for a in accepted)
    moved = targets[-1].pose.position.x - targets[0].pose.position.x
    assert moved == pytest.approx((STEPS - 1) * MAX_DELTA_M * BIAS[0], abs=1e-6)

    # The rates depend on the machine, so a quarter of the nominal one is enough. The streams have to last to the end.
    start_s, end_s = stamp_s(started.header.stamp), stamp_s(ended.header.stamp)
    span = end_s - start_s
    assert span == pytest.approx(STEPS * 0.5, abs=1.5)
    for topic, least_hz in (("/dlo/keypoints", 15), ("/dlo/mask", 15), ("/panda/current_pose", 50), ("/panda/arm_state", 12)):
        during = [at_s for m in topics[topic] if start_s <= (at_s := stamp_s(m.header.stamp)) <= end_s]
        assert len(during) > least_hz * span, topic
        assert during[-1] > end_s - 1, topic


def test_the_recording_states_qos_and_hashes(graph, episode):
    bag, hashes = episode[2], type_hashes("*/msg/*.json")
    document = YAML(typ="safe").load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    rows = {row["topic_metadata"]["name"]: row["topic_metadata"] for row in document["topics_with_message_count"]}
    assert set(rows) == set(CONTRACT)
    for name, row in CONTRACT.items():
        (profile,) = rows[name]["offered_qos_profiles"]
        assert (profile["reliability"], profile["durability"], profile["depth"]) == (row.reliability, row.durability, row.depth), name
        assert rows[name]["type"] == row.type_name
        assert rows[name]["type_description_hash"] == hashes[row.type_name], name
    recorded = json.loads(graph.text("record.out"))
    assert recorded["messages"] == document["message_count"] == sum(count for _, count in recorded["topics"])


def test_the_recording_can_be_inferred_from(graph, episode):
    sizes = ("--preset", "networks", "--iterations", 1, "--simulations", 40, "--out", graph.folder / "inferred", "--json")
    done = graph.run("infer", "--bag", episode[2], "--model", MODEL, *sizes)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert {m["name"] for m in report["marginals"]} == {"length_m", "youngs_modulus_pa"}
    assert report["duration_s"] == pytest.approx(STEPS * 0.5, abs=0.5)


def test_the_result_of_an_inference_is_latched_on_the_topic_of_the_posterior(graph, episode):
    goal = Infer.Goal(
        source=Infer.Goal.SOURCE_BAG,
        bags=[str(episode[2])],
        model_yaml=MODEL.read_text(),
        preset="networks",
        iterations=2,
        simulations=40,
        drive=Simulate.Request.DRIVE_GRIP,
        seed=5,
    )
    run = Goal(graph.ros, Infer, "/bayes_sim/infer", goal, seconds=60)
    result = run.result()
    assert result.success and result.simulations == 80 and len(result.losses) == 2
    assert run.feedback and run.feedback[-1].iterations == 2
    components = len(result.posterior.weights)
    assert sum(result.posterior.weights) == pytest.approx(1) and len(result.posterior.covariances) == 4 * components
    late, profile = [], QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.ros.node.create_subscription(Mixture, "/bayes_sim/posterior", late.append, profile)
    graph.ros.wait_for(lambda: late, 10, "the latched posterior")
    assert late[0] == result.posterior


# After 0.4 s the first round is being simulated, after 4 s the networks learn. A training step of the paper's preset is long.
@pytest.mark.parametrize(("preset", "after_s"), [("default", 0.4), ("default", 4), ("paper", 8)])
def test_an_inference_is_cancelled_at_once(graph, episode, preset, after_s):
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(episode[2])], model_yaml=MODEL.read_text(), preset=preset)
    goal.drive = Simulate.Request.DRIVE_GRIP
    # More iterations than fit into the time, and a seed of its own, so that no kept state of another inference is resumed.
    goal.iterations, goal.seed = 200, int(100 + 10 * after_s)
    run = Goal(graph.ros, Infer, "/bayes_sim/infer", goal)
    assert not run.ends_within(after_s), "it ended by itself"
    asked = time.monotonic()
    run.cancel()
    run.result(GoalStatus.STATUS_CANCELED)
    took_s = time.monotonic() - asked
    print(f"{preset}, cancelled after {after_s} s: over after {took_s:.2f} s")
    # Within 1 s on an idle machine; the rest is for a busy one.
    assert took_s < 3


def test_an_interrupted_deploy_cancels_the_episode_and_stops_the_arm(graph):
    policy = graph.folder / "constant.safetensors"
    policy.write_bytes(policy_file())
    events, states, latched = [], [], DurabilityPolicy.TRANSIENT_LOCAL
    graph.ros.node.create_subscription(EpisodeEvent, "/episode/event", events.append, QoSProfile(depth=16, durability=latched))
    graph.ros.node.create_subscription(ArmState, "/panda/arm_state", states.append, QoSProfile(depth=1, durability=latched))
    actions = graph.ros.listen(EefDelta, "/policy/action")
    # The bar still swings from the episodes before.
    graph.ros.set_parameter("policy_runner", "still_patience_s", 0.0)
    deploy = graph.start("deploy", "--policy", policy, "--run-all-steps")
    graph.ros.wait_for(lambda: len(actions) >= 3, 60, "three steps")
    deploy.send_signal(signal.SIGINT)
    ended = lambda: (events[-1].event, events[-1].reason) == (EpisodeEvent.ENDED, "cancelled")
    graph.ros.wait_for(ended, 3, "the end of the cancelled episode")
    graph.ros.wait_for(lambda: states[-1].mode == ArmState.MODE_IDLE, 2, "an arm that is not enabled")
    assert deploy.wait(10) == 130
    assert "run_episode: interrupted and cancelled" in graph.text("deploy.err")
    steps = len(actions)
    assert not graph.ros.holds_within(lambda: len(actions) > steps, 1.5) and steps < STEPS
