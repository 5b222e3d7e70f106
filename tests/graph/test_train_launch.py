"""What `train.launch.xml` starts: learning alone, in any namespace, for clients of rclpy and for the command line."""

import json

from catenary_msgs.action import Infer, Train
from rclpy.action import ActionClient

LEARNERS = {"simulator_pool", "ppo_trainer", "bayes_sim"}


def result_of(ros, kind, name, goal):
    client = ActionClient(ros.node, kind, name)
    ros.wait_for(client.server_is_ready, 20, name)
    feedback = []
    handle = ros.result(client.send_goal_async(goal, feedback_callback=feedback.append), 20, "an answer to the goal")
    assert handle.accepted
    return ros.result(handle.get_result_async(), 120, "a result").result, feedback


def test_learning_alone_serves_rclpy_and_the_command_line(session):
    launch = session.launch("workers:=2", file="train.launch.xml", nodes=LEARNERS)
    model_file, bag = session.root / "launch_configs/models/soft_bar.yaml", session.root / "bags/swing"
    goal = Train.Goal(model_yaml=model_file.read_text(), total_steps=512, seed=5)
    trained, feedback = result_of(session.ros, Train, "/ppo_trainer/train", goal)
    assert trained.success and feedback, trained.message
    done = session.run("train", "--node", "--model", model_file, "--out", "pi.safetensors", "--steps", 512, "--seed", 5, "--json")
    assert done.returncode == 0, done.stderr
    assert (session.folder / "pi.safetensors").read_bytes() == bytes(trained.policy), "the same goal gives the same policy"
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(bag)], model_yaml=model_file.read_text(), iterations=1, simulations=40, seed=2)
    inferred, _ = result_of(session.ros, Infer, "/bayes_sim/infer", goal)
    assert inferred.success and inferred.simulations == 40, inferred.message
    done = session.run(
        "infer", "--node", "--bag", bag, "--model", model_file, "--out", "out", "--iterations", 1, "--simulations", 40, "--seed", 2, "--json"
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    posterior = json.loads(done.stdout)["posterior"]
    assert posterior["mixture"]["weights"] == list(inferred.posterior.weights), "the same goal gives the same posterior"
    status = session.run("status", "--log", session.folder / "log", "--json")
    assert status.returncode == 0 and {row["name"] for row in json.loads(status.stdout)["processes"]} == LEARNERS
    session.stop(launch)
    session.wait_until_empty(1)


def test_learning_has_a_namespace_of_its_own(session):
    session.launch("namespace:=/lab", "inference:=false", file="train.launch.xml", nodes=LEARNERS - {"bayes_sim"})
    assert ("ppo_trainer", "/lab") in session.ros.node.get_node_names_and_namespaces()
    model_file = session.root / "launch_configs/models/soft_bar.yaml"
    done = session.run("train", "--node=/lab", "--model", model_file, "--out", "pi.safetensors", "--steps", 512, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["steps"] >= 512
    elsewhere = session.run("train", "--node", "--model", model_file, "--out", "pi.safetensors", "--wait-s", 1)
    assert elsewhere.returncode == 1 and "/ppo_trainer/train" in elsewhere.stderr
