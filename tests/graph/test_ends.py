"""How things end: a node that is killed comes back, and whatever ends the supervisor leaves no process behind."""

import os
import signal
import time

from action_msgs.msg import GoalStatus
from catenary_msgs.action import Infer, Train
from catenary_msgs.msg import EefDelta, Keypoints
from geometry_msgs.msg import PoseStamped
from policy import policy_file
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rosbags.highlevel import AnyReader
from stand_ins import Stranger


def counts(bag):
    """Messages by topic, each of them decoded."""
    found = {}
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found[connection.topic] = found.get(connection.topic, 0) + 1
    return found


def keep_busy(session):
    """Has the graph compute for much longer than the test lasts; returns when it does."""
    client = ActionClient(session.ros.node, Train, "/ppo_trainer/train")
    session.ros.wait_for(client.server_is_ready, 20, "the training server")
    model = (session.root / "launch_configs/models/soft_bar.yaml").read_text()
    goal = Train.Goal(model_yaml=model, preset="default", total_steps=10_000_000, seed=1)
    feedback = []
    handle = session.ros.result(client.send_goal_async(goal, feedback_callback=feedback.append), 20, "an answer to the goal")
    assert handle.accepted
    session.ros.wait_for(lambda: feedback, 40, "progress of the training")


def test_a_killed_node_is_started_again_and_keypoints_flow(session):
    session.launch()
    messages = session.ros.listen(Keypoints, "/dlo/keypoints")
    session.ros.wait_for(lambda: len(messages) > 30, 30, "keypoints")
    first = session.pid_of("keypoint_tracker")
    os.kill(first, signal.SIGKILL)
    killed = time.time()

    def flow_again():
        messages[:] = messages[-200:]
        return sum(m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec > killed + 0.5 for m in messages) > 30

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
    assert session.pid_of("policy_runner"), "the launch did not start it again"


def infers(session, client, simulations):
    """The goal of an inference that takes some seconds, and its result to come."""
    model = (session.root / "launch_configs/models/soft_bar.yaml").read_text()
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(session.root / "bags/swing")], model_yaml=model, iterations=2)
    goal.simulations, goal.seed = simulations, 6
    handle = session.ros.result(client.send_goal_async(goal), 20, "an answer to the goal")
    return handle.get_result_async()


def test_an_inference_goes_on_with_the_pool_that_is_started_anew(session):
    session.launch()
    client = ActionClient(session.ros.node, Infer, "/bayes_sim/infer")
    session.ros.wait_for(client.server_is_ready, 20, "the inference server")
    whole = session.ros.result(infers(session, client, 600), 120, "the whole inference").result
    cut = infers(session, client, 600)
    assert not session.ros.holds_within(cut.done, 1.5), "it was over before the pool died"
    os.kill(session.pid_of("simulator_pool"), signal.SIGKILL)
    answer = session.ros.result(cut, 120, "the inference whose pool died")
    assert answer.status == GoalStatus.STATUS_SUCCEEDED and answer.result.simulations == 1200
    assert answer.result.posterior == whole.posterior


def test_an_inference_whose_node_was_killed_goes_on_when_it_is_asked_again(session):
    session.launch()
    model = (session.root / "launch_configs/models/soft_bar.yaml").read_text()
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(session.root / "bags/swing")], model_yaml=model, seed=7)
    goal.iterations, goal.simulations = 5, 150

    def ask():
        client = ActionClient(session.ros.node, Infer, "/bayes_sim/infer")
        session.ros.wait_for(client.server_is_ready, 20, "the inference server")
        feedback = []
        heard = lambda message: feedback.append(message.feedback)
        deadline = time.monotonic() + 40
        while True:
            asked = client.send_goal_async(goal, feedback_callback=heard)
            # A node that was killed counts as there until its lease ends.
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


def test_an_inference_without_a_pool_ends_when_its_patience_does(session):
    session.launch("respawn:=false")
    client = ActionClient(session.ros.node, Infer, "/bayes_sim/infer")
    session.ros.wait_for(client.server_is_ready, 20, "the inference server")
    parameters = AsyncParameterClient(session.ros.node, "bayes_sim")
    session.ros.wait_for(parameters.services_are_ready, 20, "the parameter services")
    session.ros.result(parameters.set_parameters([Parameter("pool_patience_s", value=3.0)]), 20, "an answer")
    result = infers(session, client, 20_000)
    assert not session.ros.holds_within(result.done, 2), "it was over before the pool died"
    os.kill(session.pid_of("simulator_pool"), signal.SIGKILL)
    answer = session.ros.result(result, 40, "the end of the inference")
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "no pool has been at work for 3 s" in answer.result.message


def test_a_launch_says_what_it_runs_without_and_does_not_start_it_again(session):
    theirs = session.folder / "log/simulated_cell.log"
    theirs.parent.mkdir()
    theirs.write_text("simulated_cell: what an earlier launch said\n")
    file, arguments = session.root / "launch_configs/sim.launch.xml", ("learning:=false", "cell_theta:=[90.0, 1000.0]")
    launch = session.start("launch", file, "--log", theirs.parent, *arguments)
    session.wait_for(lambda: "runs without" in session.text("launch.err"), 20, "the end of the cell")
    time.sleep(2)
    err = session.text("launch.err")
    assert err.count("simulated_cell failed with exit code 2: simulated_cell: ") == 1 and "`length_m`" in err
    assert "the graph runs without simulated_cell" in err and "earlier launch" not in err
    launch.send_signal(signal.SIGINT)
    assert launch.wait(10) == 1
    assert session.text("launch.err").splitlines()[-1] == "catenary: ended with an error: simulated_cell"


def test_a_recording_is_not_replayed_over_a_running_cell(session):
    session.launch("learning:=false", nodes=session.nodes - {"simulator_pool", "bayes_sim", "ppo_trainer", "effect_finder"})
    done = session.run("replay", session.root / "bags/swing")
    assert done.returncode == 1 and done.stdout == ""
    assert "others publish" in done.stderr and "/panda/current_pose" in done.stderr and "allow_others" in done.stderr
    done = session.run("replay", session.root / "bags/swing", "--allow-others", "--rate", 20)
    assert done.returncode == 0, done.stderr


def test_a_killed_supervisor_leaves_no_process(session):
    launch = session.launch()
    keep_busy(session)
    assert len(session.processes()) == 1 + len(session.nodes)
    launch.kill()
    launch.wait()
    session.wait_until_empty(10)


def test_an_interrupted_launch_ends_in_order(session):
    launch = session.launch()
    bag = session.folder / "bag"
    recorder = session.start("record", "--out", bag)
    session.wait_for(bag.exists, 30, "the recorder's bag")
    keep_busy(session)
    poses = session.ros.listen(PoseStamped, "/panda/current_pose")
    keypoints = session.ros.listen(Keypoints, "/dlo/keypoints")
    # How much flows while the graph gets busy is the machine's affair.
    session.ros.wait_for(lambda: len(poses) > 100 and len(keypoints) > 30, 30, "poses and keypoints")
    launch.send_signal(signal.SIGINT)
    assert launch.wait(8) in (0, 130)
    assert list(session.processes()) == [recorder.pid], "a node outlived the launch"
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(8) == 0
    session.wait_until_empty(1)
    found = counts(bag)
    assert found["/panda/current_pose"] > 50 and found["/dlo/keypoints"] > 15


def test_an_interrupted_demo_says_so_and_keeps_its_bag(session):
    # A laboratory in the user's domain, which the demo must leave alone.
    with Stranger(session.domain) as lab:
        demo = session.start("demo", "--out", "demo")
        frames = session.folder / "demo/frames"
        session.wait_for(lambda: demo.poll() is not None or len(list(frames.glob("*.png"))) >= 4, 240, "four steps of pi0 on the cell")
        demo.send_signal(signal.SIGINT)
        assert demo.wait(20) == 130
    assert lab.received == []
    assert session.text("demo.out") == ""
    where, own, how, *rest = session.text("demo.err").splitlines()
    assert own.startswith("catenary demo: in DDS domain ") and "ROS_DOMAIN_ID=" in how and f"ROS_DOMAIN_ID={session.domain} " not in how
    assert where == f"catenary demo: results go to {session.folder / 'demo'}"
    stages, last = [line.split(": ")[0] for line in rest[:-1]], rest[-1]
    assert stages == ["start the graph", "train pi0 over the prior"] and last == "catenary: run pi0 on the cell: interrupted"
    session.wait_until_empty(1)
    found = counts(session.folder / "demo/bags/pi0")
    assert found["/policy/action"] >= 3 and found["/dlo/keypoints"] > 20 and found["/episode/event"] >= 1


def test_a_process_that_was_stopped_and_goes_on_does_not_pretend_to_hear_the_graph(session):
    session.launch()
    messages = session.ros.listen(Keypoints, "/dlo/keypoints")
    session.ros.wait_for(lambda: len(messages) > 30, 30, "keypoints")
    recorder = session.start("record", "--out", "bag", name="recorder")
    session.wait_for((session.folder / "bag").exists, 20, "the bag")
    session.ros.holds_within(lambda: False, 2)
    replay = session.start("replay", session.root / "bags/swing", "--loop", "--topics", "/panda/current_pose", "--allow-others", name="replay")
    session.ros.wait_for(lambda: session.ros.node.count_publishers("/panda/current_pose") > 1, 20, "the replay")
    tracker = session.pid_of("keypoint_tracker")

    def left():
        return [c.pid for c in (recorder, replay) if c.poll() is None] + [tracker] * (session.pid_of("keypoint_tracker") == tracker)

    # One whose discovery was not waiting at that moment, as it does nearly always, has lost nothing and goes on: then once more.
    for _ in range(5):
        stopped = left()
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        session.ros.holds_within(lambda: False, 1)
        for pid in stopped:
            os.kill(pid, signal.SIGCONT)
        if session.ros.holds_within(lambda: not left(), 10):
            break
    messages.clear()
    # A recorder ends with a whole bag and an error; a node is started anew.
    assert recorder.wait(20) == 1
    assert "the network was lost" in session.text("recorder.err")
    assert counts(session.folder / "bag")["/dlo/keypoints"] > 0
    # What was cut short by it is no interruption.
    assert replay.wait(20) == 1
    assert "the network was lost" in session.text("replay.err")
    session.ros.wait_for(lambda: len(messages) > 30, 20, "keypoints of the tracker that was started anew")
    assert session.pid_of("keypoint_tracker") not in (None, tracker)
