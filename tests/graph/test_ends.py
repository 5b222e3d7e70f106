"""Ends of launches and of commands in a graph: each is reported, and none leaves a process behind."""

import os
import signal
import time

from action_msgs.msg import GoalStatus
from catenary_msgs.action import Infer, Train
from catenary_msgs.msg import Keypoints
from geometry_msgs.msg import PoseStamped
from rosbags.highlevel import AnyReader

from support.program import BAG, MODEL
from support.ros import Goal
from support.stamps import stamp_s
from support.stand_ins import Stranger


def counts(bag):
    """Number of messages by topic; every message is decoded."""
    found = {}
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            found[connection.topic] = found.get(connection.topic, 0) + 1
    return found


def keep_busy(session):
    """Starts a training that takes much longer than the test; returns when it makes progress."""
    goal = Train.Goal(model_yaml=MODEL.read_text(), preset="default", total_steps=10_000_000, seed=1)
    Goal(session.ros, Train, "/ppo_trainer/train", goal, seconds=40).wait_feedback()


def test_an_inference_without_a_pool_ends_when_its_patience_does(session):
    session.launch("respawn:=false")
    session.ros.set_parameter("bayes_sim", "pool_patience_s", 3.0)
    wanted = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=MODEL.read_text(), preset="networks", iterations=2)
    wanted.simulations = 20_000
    goal = Goal(session.ros, Infer, "/bayes_sim/infer", wanted, seconds=40)
    assert not goal.ends_within(2), "it was over before the pool died"
    os.kill(session.pid_of("simulator_pool"), signal.SIGKILL)
    assert "no pool has been at work for 3 s" in goal.result(GoalStatus.STATUS_ABORTED).message


def test_a_launch_names_a_node_that_refuses_its_arguments_and_does_not_start_it_again(session):
    theirs = session.folder / "log/simulated_cell.log"
    theirs.parent.mkdir()
    theirs.write_text("simulated_cell: what an earlier launch said\n")
    file, arguments = session.root / "launch_configs/sim.launch.xml", ("learning:=false", "cell_theta:=[90.0, 1000.0]")
    launch = session.start("launch", file, "--log", theirs.parent, *arguments)
    session.wait_for(lambda: "runs without" in session.text("launch.err"), 20, "the end of the cell")
    # Longer than the delay of a restart, which must not come.
    time.sleep(2)
    err = session.text("launch.err")
    assert err.count("simulated_cell failed with exit code 2: simulated_cell: ") == 1 and "`length_m`" in err
    assert "the graph runs without simulated_cell" in err and "earlier launch" not in err
    launch.send_signal(signal.SIGINT)
    assert launch.wait(10) == 1
    assert session.text("launch.err").splitlines()[-1] == "catenary: ended with an error: simulated_cell"


def test_a_recording_is_not_replayed_over_a_running_cell(session):
    session.launch("learning:=false", nodes=session.nodes - {"simulator_pool", "bayes_sim", "ppo_trainer", "effect_finder"})
    done = session.run("replay", BAG)
    assert done.returncode == 1 and done.stdout == ""
    assert "others publish" in done.stderr and "/panda/current_pose" in done.stderr and "allow_others" in done.stderr
    done = session.run("replay", BAG, "--allow-others", "--rate", 20)
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
    # The rates of a busy graph depend on the machine, so only the counts are waited for.
    session.ros.wait_for(lambda: len(poses) > 100 and len(keypoints) > 30, 30, "poses and keypoints")
    launch.send_signal(signal.SIGINT)
    assert launch.wait(8) in (0, 130)
    assert list(session.processes()) == [recorder.pid], "a node outlived the launch"
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(8) == 0
    session.wait_until_empty(1)
    found = counts(bag)
    assert found["/panda/current_pose"] > 50 and found["/dlo/keypoints"] > 15


def interrupted_demo(session, name):
    """Runs the demo into its inference and interrupts it; returns the lines that it wrote to stderr."""
    demo = session.start("demo", "--out", "demo", name=name)
    is_inferring = lambda: demo.poll() is not None or "run pi0 on the cell: " in session.text(f"{name}.err")
    session.wait_for(is_inferring, 400, "the episode of pi0")
    demo.send_signal(signal.SIGINT)
    assert demo.wait(30) == 130
    assert session.text(f"{name}.out") == ""
    session.wait_until_empty(1)
    return session.text(f"{name}.err").splitlines()


def test_an_interrupted_demo_keeps_what_is_finished_and_goes_on(session):
    folder = session.folder / "demo"
    # A laboratory in the domain of the environment, to which the demo must send nothing.
    with Stranger(session.domain) as lab:
        where, own, how, *rest = interrupted_demo(session, "first")
    assert lab.received == []
    assert where == f"catenary demo: results go to {folder}"
    assert (
        own.startswith("catenary demo: runs in its own DDS domain ")
        and "ROS_DOMAIN_ID=" in how
        and f"ROS_DOMAIN_ID={session.domain} " not in how
    )
    names = lambda lines: [line.split(": ")[0] for line in lines]
    stages = ["start the graph", "train pi0 over the prior", "run pi0 on the cell"]
    *done, report, last = rest
    assert names(done) == stages and report == f"report so far: {folder / 'report/index.html'}"
    assert last == "catenary: infer the parameters: interrupted; the same command goes on from here"
    page = (folder / "report/index.html").read_text()
    assert "Stopped: infer the parameters: interrupted" in page and "Camera frames: pi0" in page
    found = counts(folder / "bags/pi0")
    assert found["/policy/action"] == 6 and found["/policy/observation"] == 7 and found["/dlo/keypoints"] > 90
    # The same command does not train again, and gives the same recording.
    episode = messages_of(folder / "bags/pi0")
    where, _, _, *rest = interrupted_demo(session, "second")
    assert where == f"catenary demo: results go to {folder}, where an interrupted demo is taken up again"
    assert names(rest[:-2]) == stages and rest[1].startswith("train pi0 over the prior: kept, ")
    again = messages_of(folder / "bags/pi0")
    assert len(episode["/panda/current_pose"]) > 250
    for topic in ("/dlo/keypoints", "/panda/current_pose", "/policy/observation", "/policy/action"):
        assert episode[topic] == again[topic], topic


def messages_of(bag):
    """Bytes of the messages between start and end of the bag's episode, by topic and stamp."""
    found, ends = {}, []
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            if connection.topic == "/episode/event":
                ends.append(stamp_s(reader.deserialize(data, connection.msgtype).header.stamp))
            elif connection.topic.startswith(("/dlo/", "/panda/current_pose", "/policy/")):
                stamp = stamp_s(reader.deserialize(data, connection.msgtype).header.stamp)
                found.setdefault(connection.topic, {})[stamp] = bytes(data)
    return {topic: {s: d for s, d in all_.items() if ends[-2] <= s <= ends[-1]} for topic, all_ in found.items()}
