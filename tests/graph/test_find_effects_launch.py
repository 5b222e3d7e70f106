"""What `find_effects.launch.xml` starts: a search in bags and on topics, with the same outcome."""

import json
import re
import signal

from catenary_msgs.action import FindEffects
from rclpy.action import ActionClient
from test_train_launch import result_of

MODEL = "launch_configs/models/soft_bar.yaml"


def test_a_search_on_topics_comes_to_what_one_in_the_bag_does(session):
    model_file, actions = session.root / MODEL, session.root / "launch_configs/models/gallery.csv"
    done = session.run("simulate", "--model", model_file, "--actions", actions, "--noise", "--seed", 3, "--out", "bag")
    assert done.returncode == 0, done.stderr
    session.launch("null_sets:=19", file="find_effects.launch.xml", nodes={"effect_finder"})
    bag, model_yaml = session.folder / "bag", model_file.read_text()
    goal = FindEffects.Goal(bags=[str(bag)], model_yaml=model_yaml, seed=1)
    of_bag, feedback = result_of(session.ros, FindEffects, "/effect_finder/find", goal)
    assert of_bag.success and of_bag.verdict == "no_gap" and of_bag.model_yaml == model_yaml, of_bag.message
    told = [message.feedback for message in feedback]
    # The first one may be missed.
    assert [f.conclusion for f in told if f.conclusion][-1:] == of_bag.message.split("\n")[-1:]
    assert [f.progress for f in told] == sorted(f.progress for f in told)

    client = ActionClient(session.ros.node, FindEffects, "/effect_finder/find")
    session.ros.wait_for(client.server_is_ready, 20, "the effect finder")
    live = FindEffects.Goal(model_yaml=model_yaml, seed=1)
    handle = session.ros.result(client.send_goal_async(live), 20, "an answer to the goal")
    result = handle.get_result_async()
    assert not session.ros.holds_within(result.done, 1), "there is no episode yet"
    session.start("replay", bag)
    of_topics = session.ros.result(result, 120, "the search on topics").result
    assert (of_topics.verdict, of_topics.message) == (of_bag.verdict, of_bag.message)
    assert list(of_topics.found) == list(of_bag.found) == []


def test_a_search_in_the_graph_goes_on_after_a_cancel_and_is_judged_by_unseen_episodes(session):
    model_file, actions = session.root / MODEL, session.root / "launch_configs/models/gallery.csv"
    for name, seed in (("fitted", 5), ("unseen", 6)):
        arguments = ["--model", model_file, "--actions", actions, "--noise", "--effect", "tip_mass_kg=0.006", "--seed", seed, "--out", name]
        done = session.run("simulate", *arguments)
        assert done.returncode == 0, done.stderr
    session.launch("null_sets:=19", file="find_effects.launch.xml", nodes={"effect_finder"})
    files = ["--bag", session.folder / "fitted", "--verify", session.folder / "unseen", "--model", model_file]
    command = ["find-effects", "--node", *files, "--out", "found", "--json"]

    journals = lambda: list((session.folder / "catenary/effect_finder").glob("*.journal"))
    cancelled = session.start(*command, name="cancelled")
    session.ros.wait_for(lambda: any(path.stat().st_size > 200_000 for path in journals()), 60, "some of a search")
    cancelled.send_signal(signal.SIGINT)
    assert cancelled.wait(20) == 130 and len(journals()) == 1

    done = session.run(*command)
    assert done.returncode == 0, done.stderr
    logs = "".join(path.read_text() for path in session.folder.glob("*.err"))
    assert re.search(r"goes on with \d+ answers", logs) and journals() == []
    said = json.loads(done.stdout)
    assert any("tip_mass_kg" in alike.split("|") for alike in said["found"]), said
    assert any("on 1 unseen episodes" in conclusion for conclusion in said["conclusions"]), said["conclusions"]
    model = (session.folder / "found/model.yaml").read_text()
    assert "tip_mass_kg" in model
    told_apart = all("|" not in alike for alike in said["found"])
    assert told_apart != (session.folder / "found/separating_motion.csv").exists()
