"""Inference and training in the graph of `train.launch.xml`, in any namespace, for clients in rclpy and the command line."""

import json

from catenary_msgs.action import Infer, Train

from support.program import BAG, MODEL
from support.ros import Goal

LEARNERS = {"simulator_pool", "ppo_trainer", "bayes_sim"}


def test_learning_alone_serves_rclpy_and_the_command_line(session):
    launch = session.launch("workers:=2", file="train.launch.xml", nodes=LEARNERS)
    model_yaml = MODEL.read_text()
    train = Goal(session.ros, Train, "/ppo_trainer/train", Train.Goal(model_yaml=model_yaml, total_steps=512, seed=5), seconds=120)
    trained = train.result()
    assert trained.success and train.feedback, trained.message
    done = session.run("train", "--node", "--model", MODEL, "--out", "pi.safetensors", "--steps", 512, "--no-plan", "--seed", 5, "--json")
    assert done.returncode == 0, done.stderr
    assert (session.folder / "pi.safetensors").read_bytes() == bytes(trained.policy), "the same goal gives the same policy"
    sizes = {"preset": "networks", "iterations": 1, "simulations": 40, "seed": 2}
    goal = Infer.Goal(source=Infer.Goal.SOURCE_BAG, bags=[str(BAG)], model_yaml=model_yaml, **sizes)
    inferred = Goal(session.ros, Infer, "/bayes_sim/infer", goal, seconds=120).result()
    assert inferred.success and inferred.simulations == 40, inferred.message
    options = [word for name, value in sizes.items() for word in (f"--{name}", value)]
    done = session.run("infer", "--node", "--bag", BAG, "--model", MODEL, "--out", "out", *options, "--json")
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
    done = session.run("train", "--node=/lab", "--model", MODEL, "--out", "pi.safetensors", "--steps", 512, "--no-plan", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["steps"] >= 512
    elsewhere = session.run("train", "--node", "--model", MODEL, "--out", "pi.safetensors", "--wait-s", 1)
    assert elsewhere.returncode == 1 and "/ppo_trainer/train" in elsewhere.stderr
