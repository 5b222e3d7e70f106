"""Our nodes and commands as clients of servers in rclpy, as in a lab with its own arm, policy runner or simulator."""

import array
import json
import signal

import pytest
from action_msgs.msg import GoalStatus
from catenary_msgs.action import Infer, RunEpisode, Train
from catenary_msgs.msg import ArmState
from diagnostic_msgs.msg import DiagnosticArray

from support.contract import ACTIONS, BASE, BY_NAME, SERVICES
from support.policy import BIAS, policy_file
from support.program import BAG, MODEL
from support.ros import Goal
from support.stand_ins import Arm, Learner, Pool, Runner, StandIn


def test_every_caller_of_the_table_is_tested_here():
    callers = {row.caller for row in (*SERVICES, *ACTIONS) if row.caller}
    commands = {"catenary deploy", "catenary infer", "catenary train", "catenary find-effects"}
    assert callers == {"policy_runner", "bayes_sim", "ppo_trainer"} | commands


@pytest.fixture(scope="module")
def learners(session_of_module):
    """Nodes of inference and training beside a pool in rclpy."""
    session = session_of_module
    for node in ("bayes_sim", "ppo_trainer"):
        session.node(node)
    session.meet("bayes_sim", "ppo_trainer")
    with Pool(session.domain) as pool:
        session.ros.wait_for(lambda: pool.sees("bayes_sim", "ppo_trainer"), 20, "the pool, to see the nodes")
        yield session, pool


@pytest.mark.parametrize("name", ["/simulator_pool/simulate"])
def test_node_to_rclpy_inference_asks_a_pool_of_rclpy(learners, name):
    session, pool = learners
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=MODEL.read_text(), preset="networks")
    goal.iterations, goal.simulations, goal.seed = 1, 30, 4
    result = Goal(session.ros, BY_NAME["/bayes_sim/infer"].kind, "/bayes_sim/infer", goal).result()
    assert result.success and result.simulations == 30
    # More than two parameters for each of the 30: the posterior's predictions are simulated, too.
    assert sum(len(request.theta) for request in pool.simulated) > 2 * 30
    first = pool.simulated[0]
    assert first.model_yaml == goal.model_yaml and len(first.frame_times) > 1
    assert first.grip.time and len(first.grip.x) == len(first.grip.time)


@pytest.mark.parametrize("name", ["/simulator_pool/open_envs", "/simulator_pool/step_envs", "/simulator_pool/close_envs"])
def test_node_to_rclpy_training_asks_a_pool_of_rclpy(learners, name):
    session, pool = learners
    pool.opened.clear()
    pool.closed.clear()
    before = pool.stepped
    goal = Train.Goal(model_yaml=MODEL.read_text(), total_steps=64, environments=2, seed=2)
    trained = Goal(session.ros, BY_NAME["/ppo_trainer/train"].kind, "/ppo_trainer/train", goal).result()
    assert trained.success and b"catenary policy 2" in bytes(trained.policy)
    (opened,) = pool.opened
    assert opened.count == 2 and opened.model_yaml == goal.model_yaml and opened.domains and len(opened.domains) % 2 == 0
    assert pool.stepped - before >= 32 and pool.closed == [7]


@pytest.fixture
def runner_and_arm(session):
    """The policy runner beside an arm in rclpy that it has heard."""
    session.node("policy_runner", "-p", f"model_file:={MODEL}")
    ros = session.meet("policy_runner")
    with Arm(session.domain) as arm:
        reports = []
        ros.node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 10)
        heard = lambda key: any(v.key == key and int(v.value) > 0 for r in reports for v in r.status[0].values)
        ros.wait_for(lambda: heard("poses_received") and heard("arm_states_received"), 20, "the runner, to hear the arm")
        yield ros, arm


def episode(ros):
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), max_steps=3, run_all_steps=True)
    return Goal(ros, BY_NAME["/policy_runner/run_episode"].kind, "/policy_runner/run_episode", goal)


def deploy(session, *arguments):
    (session.folder / "policy").write_bytes(policy_file())
    return session.start("deploy", "--policy", "policy", *arguments)


@pytest.mark.parametrize("name", ["/panda/enable"])
def test_node_to_rclpy_enables_an_arm_of_rclpy(runner_and_arm, name):
    ros, arm = runner_and_arm
    result = episode(ros).result()
    assert result.success and len(result.rewards) == 3
    assert arm.requests == [True, False]
    moved = [target.pose.position.x for target in arm.targets]
    assert moved == pytest.approx([0.40 + 0.06 * BIAS[0] * (step + 1) for step in range(3)])


def test_an_episode_takes_no_notice_of_a_state_from_before_its_goal(runner_and_arm):
    ros, arm = runner_and_arm
    # The last state of the motion to the start, after which the arm answers its client and tells no state for a while.
    arm.disabled_mode, arm.swing_px = ArmState.MODE_MOVING, 30.0
    ros.spin(0.2)
    arm.disabled_mode = None
    run = episode(ros)
    assert not run.ends_within(0.5), run.answer.result().result
    arm.disabled_mode, arm.swing_px = ArmState.MODE_IDLE, 0.0
    assert run.result().success and arm.requests == [True, False]


@pytest.mark.parametrize("name", ["/dlo/keypoints", "/panda/current_pose", "/panda/arm_state", "/panda/accepted_target"])
def test_a_second_writer_of_what_an_episode_hears_ends_it_and_both_are_named(session, runner_and_arm, name):
    ros, arm = runner_and_arm
    (session.folder / "policy").write_bytes(policy_file())
    goal = RunEpisode.Goal(policy=array.array("B", policy_file()), run_all_steps=True)
    run = Goal(ros, BY_NAME["/policy_runner/run_episode"].kind, "/policy_runner/run_episode", goal)
    run.wait_feedback()
    row = BY_NAME[name]
    with StandIn(session.domain, "lab_double") as lab:
        publisher = lab.publisher(name)
        ros.wait_for(publisher.get_subscription_count, 20, "the runner's subscription")
        message = row.kind()
        if name != "/panda/accepted_target":
            message.header.frame_id = BASE
        if name == "/panda/current_pose":
            message.pose.orientation.w = 1.0
        # Each message is covered at once by the next of the arm's. The runner may know the publisher a little later than the reverse.
        for _ in range(50):
            publisher.publish(lab.stamped(message, message.header.frame_id))
            if run.ends_within(0.1):
                break
        refused = run.result(GoalStatus.STATUS_ABORTED)
        assert "came from /lab_double (process " in refused.message and "before from /lab_arm (process " in refused.message, refused.message
        # Nothing of the stranger is used, and the arm is disabled.
        assert arm.requests == [True, False]


def test_a_stop_in_the_wait_for_a_still_object_ends_the_episode(runner_and_arm):
    ros, arm = runner_and_arm
    arm.swing_px = 30.0
    run = episode(ros)
    arm.disabled_mode = ArmState.MODE_USER_STOP
    refused = run.result(GoalStatus.STATUS_ABORTED)
    assert refused.message == "the arm refuses commands: the user stop is pressed" and arm.requests == []


def test_a_target_that_appears_after_the_wait_is_seen(runner_and_arm):
    ros, arm = runner_and_arm
    arm.shows_target = lambda: arm.enabled
    result = episode(ros).result()
    assert result.success and len(result.rewards) == 3 and arm.requests == [True, False]


def test_a_target_that_was_taken_away_in_the_wait_is_not_followed(runner_and_arm):
    ros, arm = runner_and_arm
    arm.swing_px = 30.0
    run = episode(ros)
    ros.spin(0.5)
    arm.shows_target = lambda: False
    ros.spin(2.5)
    arm.swing_px = 0.0
    refused = run.result(GoalStatus.STATUS_ABORTED)
    assert "target within 1 s of step 0: it was not seen" in refused.message and arm.targets == []


def test_an_episode_does_not_begin_for_a_client_that_was_killed_meanwhile(session, runner_and_arm):
    _, arm = runner_and_arm
    arm.swing_px = 30.0
    child = deploy(session, "--from-here", "--wait-s", 20)
    said = lambda: session.text("policy_runner.err")
    session.wait_for(lambda: "the episode begins when the object hangs still" in said(), 20, "the wait for a still object")
    child.kill()
    child.wait(5)
    # At once, and not when the object hangs still.
    session.wait_for(lambda: "the client that asked for the episode has left the graph" in said(), 20, "the end of the goal")
    assert arm.requests == []


@pytest.mark.parametrize("name", ["/panda/move_to_start", "/policy_runner/run_episode"])
def test_node_to_rclpy_deploys_on_a_runner_of_rclpy(session, name):
    with Runner(session.domain) as runner:
        child = deploy(session, "--json", "--run-all-steps", "--wait-s", 20)
        assert child.wait(30) == 0, session.text("deploy.err")
    said = json.loads(session.text("deploy.out"))
    assert said == {"episode": 41, "end": "step_limit", "rewards": [0.25] * 3, "episode_return": 0.75}
    (goal,) = runner.goals
    assert bytes(goal.policy) == policy_file() and goal.run_all_steps and runner.moves == 1


def test_a_goal_that_rclpy_rejects_ends_the_command_with_an_error(session):
    with Runner(session.domain, refuses=True):
        child = deploy(session, "--from-here", "--wait-s", 20)
        assert child.wait(30) == 1
    assert "rejected" in session.text("deploy.err")


def test_an_interrupt_cancels_the_goal_at_a_server_of_rclpy(session):
    with Runner(session.domain, endless=True) as runner:
        child = deploy(session, "--from-here", "--wait-s", 20)
        session.wait_for(lambda: runner.goals, 20, "the goal")
        child.send_signal(signal.SIGINT)
        assert child.wait(15) == 130
    assert "interrupted and cancelled" in session.text("deploy.err")


@pytest.mark.parametrize("name", ["/bayes_sim/infer"])
def test_node_to_rclpy_has_an_inference_of_rclpy_infer(session, name):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "out", "--iterations", 2, "--seed", 9)
    with Learner(session.domain) as learner:
        child = session.start("infer", "--node", *arguments, "--wait-s", 20, "--json")
        assert child.wait(30) == 0, session.text("infer.err")
        arguments = ("--model", MODEL, "--posterior", "out/posterior.json", "--out", "pi1.safetensors", "--no-plan")
        child = session.start("train", "--node", *arguments, "--wait-s", 20)
        assert child.wait(30) == 0, session.text("train.err")
    said = json.loads(session.text("infer.out"))
    assert (said["simulations"], said["losses"], said["warnings"]) == (40, [1.5], ["a warning"])
    length = said["marginals"][0]
    assert length["name"] == "length_m" and length["median"] == pytest.approx(0.25, abs=1e-3)
    assert json.loads((session.folder / "out/posterior.json").read_text()) == said["posterior"]
    goal, over_posterior = learner.goals
    assert goal.source == Infer.Goal.SOURCE_BAG and list(goal.bags) == [str(BAG)] and goal.model_yaml == MODEL.read_text()
    assert (goal.iterations, goal.simulations, goal.seed, goal.preset) == (2, 0, 9, "default")
    assert over_posterior.domains == Train.Goal.DOMAINS_MIXTURE and list(over_posterior.mixture.means) == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("name", ["/ppo_trainer/train"])
def test_node_to_rclpy_has_a_training_of_rclpy_train(session, name):
    arguments = ("--model", MODEL, "--out", "pi0.safetensors", "--steps", 32, "--seed", 3, "--no-plan")
    with Learner(session.domain) as learner:
        child = session.start("train", "--node", *arguments, "--wait-s", 20, "--json")
        assert child.wait(30) == 0, session.text("train.err")
    said = json.loads(session.text("train.out"))
    curve = [
        {"steps": 16, "mean_return": 0.25, "success_rate": 0.0, "entropy": 1.5, "value_loss": 0.2},
        {"steps": 32, "mean_return": 0.5, "success_rate": 0.5, "entropy": 1.0, "value_loss": 0.1},
    ]
    assert said["policy"] == "pi0.safetensors" and said["curve"] == curve and said["steps"] == 32
    assert said["mean_return"]["value"] == pytest.approx(0.5) and said["success_rate"]["value"] == 0.5
    assert (session.folder / "pi0.safetensors").read_bytes() == policy_file()
    (goal,) = learner.goals
    assert (goal.total_steps, goal.seed, goal.domains) == (32, 3, Train.Goal.DOMAINS_PRIOR) and goal.model_yaml == MODEL.read_text()


@pytest.mark.parametrize("command", ["infer", "train"])
def test_an_interrupt_cancels_the_work_of_a_learner_of_rclpy(session, command):
    own = ("--bag", BAG) if command == "infer" else ("--no-plan",)
    with Learner(session.domain, endless=True) as learner:
        child = session.start(command, "--node", *own, "--model", MODEL, "--out", "out", "--wait-s", 20)
        session.wait_for(lambda: learner.goals, 20, "the goal")
        child.send_signal(signal.SIGINT)
        assert child.wait(15) == 130
        assert learner.cancelled == 1
    assert "interrupted and cancelled" in session.text(f"{command}.err") and not (session.folder / "out/posterior.json").exists()


@pytest.mark.parametrize("name", ["/effect_finder/find"])
def test_node_to_rclpy_has_a_search_of_rclpy_find(session, name):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "found", "--seed", 8)
    with Learner(session.domain) as learner:
        child = session.start("find-effects", "--node", *arguments, "--wait-s", 20, "--json")
        assert child.wait(30) == 0, session.text("find-effects.err")
    said = json.loads(session.text("find-effects.out"))
    assert said["found"] == ["tip_mass_kg"]
    assert (said["verdict"], said["effects"]) == ("named", [["tip_mass_kg", 0.75], ["density_change", 0.25]])
    assert said["conclusions"][-1] == "tip mass explains it"
    assert (session.folder / "found/model.yaml").read_text() == "version: 1\n"
    (goal,) = learner.goals
    assert list(goal.bags) == [str(BAG)] and goal.model_yaml == MODEL.read_text() and goal.seed == 8
