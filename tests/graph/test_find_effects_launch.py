"""Search for effects in the graph of `find_effects.launch.xml`: bags and topics lead to one outcome."""

import json
import re
import signal

from catenary_msgs.action import FindEffects

from support.program import MODEL, MODELS
from support.ros import Goal

ACTIONS = MODELS / "gallery.csv"


def test_a_search_on_topics_has_the_outcome_of_one_in_the_bag(session):
    done = session.run("simulate", "--model", MODEL, "--actions", ACTIONS, "--noise", "--seed", 3, "--out", "bag")
    assert done.returncode == 0, done.stderr
    session.launch("null_sets:=19", file="find_effects.launch.xml", nodes={"effect_finder"})
    bag, model_yaml = session.folder / "bag", MODEL.read_text()
    wanted = FindEffects.Goal(bags=[str(bag)], model_yaml=model_yaml, seed=1)
    goal = Goal(session.ros, FindEffects, "/effect_finder/find", wanted, seconds=120)
    of_bag, told = goal.result(), goal.feedback
    assert of_bag.success and of_bag.verdict == "no_gap" and of_bag.model_yaml == model_yaml, of_bag.message
    # The first conclusion may be sent before its reader is known.
    assert [f.conclusion for f in told if f.conclusion][-1:] == of_bag.message.split("\n")[-1:]
    assert [f.progress for f in told] == sorted(f.progress for f in told)

    live = Goal(session.ros, FindEffects, "/effect_finder/find", FindEffects.Goal(model_yaml=model_yaml, seed=1), seconds=120)
    assert not live.ends_within(1), "there is no episode yet"
    session.start("replay", bag)
    of_topics = live.result()
    assert (of_topics.verdict, of_topics.message) == (of_bag.verdict, of_bag.message)
    assert list(of_topics.found) == list(of_bag.found) == []


def test_a_search_in_the_graph_goes_on_after_a_cancel_and_is_verified_on_unseen_episodes(session):
    for name, seed in (("fitted", 5), ("unseen", 6)):
        hidden = ["--noise", "--effect", "tip_mass_kg=0.006", "--seed", seed]
        done = session.run("simulate", "--model", MODEL, "--actions", ACTIONS, *hidden, "--out", name)
        assert done.returncode == 0, done.stderr
    session.launch("null_sets:=19", file="find_effects.launch.xml", nodes={"effect_finder"})
    files = ["--bag", session.folder / "fitted", "--verify", session.folder / "unseen", "--model", MODEL]
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
    assert any("on 1 validation episodes" in conclusion for conclusion in said["conclusions"]), said["conclusions"]
    model = (session.folder / "found/model.yaml").read_text()
    assert "tip_mass_kg" in model
    told_apart = all("|" not in alike for alike in said["found"])
    assert told_apart != (session.folder / "found/separating_motion.csv").exists()
