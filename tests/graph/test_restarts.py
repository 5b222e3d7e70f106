"""Killed nodes: the launch starts each again, and running work goes on or ends with an error."""

import os
import signal
import time

from catenary_msgs.action import Infer, Train
from catenary_msgs.msg import EefDelta, Keypoints
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient

from support.policy import policy_file
from support.program import BAG, MODEL
from support.ros import Goal
from support.stamps import stamp_s


def test_a_killed_node_is_started_again_and_keypoints_flow(session):
    session.launch()
    messages = session.ros.listen(Keypoints, "/dlo/keypoints")
    session.ros.wait_for(lambda: len(messages) > 30, 30, "keypoints")
    first = session.pid_of("keypoint_tracker")
    os.kill(first, signal.SIGKILL)
    killed = time.time()

    def flow_again():
        messages[:] = messages[-200:]
        return sum(stamp_s(m.header.stamp) > killed + 0.5 for m in messages) > 30

    session.ros.wait_for(flow_again, 10, "keypoints after the restart")
    assert session.pid_of("keypoint_tracker") not in (None, first)
    assert "keypoint_tracker was killed by signal 9" in session.text("launch.err")


def test_a_deployment_ends_when_the_runner_of_its_policy_dies(session):
    session.launch()
    (session.folder / "policy").write_bytes(policy_file())
    actions = session.ros.listen(EefDelta, "/policy/action")
    deploy = session.start("deploy", "--policy", "policy")
    session.ros.wait_for(lambda: len(actions) >= 2 or deploy.poll() is not None, 30, "two actions of the policy")
    os.kill(session.pid_of("policy_runner"), signal.SIGKILL)
    assert deploy.wait(25) == 1
    assert session.text("deploy.out") == ""
    assert "run_episode: its server went away while the goal ran" in session.text("deploy.err").splitlines()[-1]
    session.wait_for(lambda: session.pid_of("policy_runner"), 10, "the runner that is started again")


STOPPED = {
    "policy_runner": ("deploy", "--policy", "policy"),
    "ppo_trainer": ("train", "--node", "--model", MODEL, "--out", "p", "--steps", 50_000_000, "--no-plan"),
}


def test_a_command_ends_soon_when_the_node_that_it_waits_for_is_stopped(session):
    """Discovery keeps a stopped process for up to a minute: the silence of its diagnostics tells of it.

    It takes the cancellation when it goes on.
    """
    session.launch()
    (session.folder / "policy").write_bytes(policy_file())
    reports = session.ros.listen(DiagnosticArray, "/diagnostics")
    heard = lambda name: sum(status.name == name for message in reports for status in message.status)
    feedback = session.ros.listen(Train.Impl.FeedbackMessage, "/ppo_trainer/train/_action/feedback")
    begun = {
        # While it waits for an object that hangs still.
        "policy_runner": lambda: "run_episode, asked for by /deploy" in session.text("launch.err"),
        # Seven seconds of a training: a node that computes sends its diagnostics, and is not given up.
        "ppo_trainer": lambda: feedback and heard("/ppo_trainer") >= before + 7,
    }
    for node, command in STOPPED.items():
        before = heard(f"/{node}")
        child = session.start(*command, name=node)
        is_begun = begun[node]
        session.ros.wait_for(lambda child=child, is_begun=is_begun: child.poll() is not None or is_begun(), 60, "the work")
        pid = session.pid_of(node)
        os.kill(pid, signal.SIGSTOP)
        try:
            # Discovery would need 50 s.
            code = child.wait(30)
        finally:
            os.kill(pid, signal.SIGCONT)
        last = session.text(f"{node}.err").splitlines()[-1]
        assert (code, session.text(f"{node}.out")) == (1, ""), last
        assert f": /{node} (process {pid}) has been silent for 5 s while its result was awaited; it was asked to cancel the goal" in last
        assert last.endswith("; the arm was disabled") == (node == "policy_runner"), last


def infer(session, simulations, seconds=120):
    """Starts an inference that takes some seconds."""
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=MODEL.read_text(), preset="networks", iterations=2)
    goal.simulations, goal.seed = simulations, 6
    return Goal(session.ros, Infer, "/bayes_sim/infer", goal, seconds)


def test_an_inference_goes_on_with_a_restarted_pool(session):
    session.launch()
    whole = infer(session, 600).result()
    cut = infer(session, 600)
    assert not cut.ends_within(1.5), "it was over before the pool died"
    os.kill(session.pid_of("simulator_pool"), signal.SIGKILL)
    resumed = cut.result()
    assert resumed.simulations == 1200 and resumed.posterior == whole.posterior


def test_an_inference_whose_node_was_killed_goes_on_with_the_next_request(session):
    session.launch()
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=MODEL.read_text(), preset="networks", seed=7)
    goal.iterations, goal.simulations = 5, 150

    def ask():
        client = ActionClient(session.ros.node, Infer, "/bayes_sim/infer")
        session.ros.wait_for(client.server_is_ready, 20, "the inference server")
        feedback = []
        heard = lambda message: feedback.append(message.feedback)
        deadline = time.monotonic() + 40
        while True:
            asked = client.send_goal_async(goal, feedback_callback=heard)
            # The killed node still counts as a server until its lease ends, and may get the goal.
            if session.ros.holds_within(asked.done, 3):
                return asked.result().get_result_async(), feedback
            assert time.monotonic() < deadline, "no answer to the goal"

    result, _ = ask()
    whole = session.ros.result(result, 120, "the whole inference").result
    _, feedback = ask()
    session.ros.wait_for(lambda: feedback, 60, "an iteration")
    killed = session.pid_of("bayes_sim")
    os.kill(killed, signal.SIGKILL)
    session.wait_for(lambda: session.pid_of("bayes_sim") not in (None, killed), 20, "the node that is started again")
    result, rest = ask()
    resumed = session.ros.result(result, 120, "the rest of the inference").result
    assert resumed.success and resumed.posterior == whole.posterior and resumed.losses == whole.losses
    assert rest[0].iteration > 1 and len(rest) < 5, "it began anew"
    assert "which an earlier process made" in session.text("log/bayes_sim.log")
    assert list((session.folder / "catenary/bayes_sim").iterdir()) == [], "the state of an inference that has ended"
