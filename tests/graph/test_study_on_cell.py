"""`catenary study --cell` deploys on the whole graph, in a DDS domain of its own, with a cell that holds the hidden object."""

import json
import signal
import time

SMALL = (
    *("--objects", "dlo_0", "--seeds", 2, "--steps", 768, "--history", 2, "--no-plan"),
    *("--episodes", 4, "--repeats", 2, "--evidence", "1:2x40"),
)


def frames_of(path):
    return json.loads(path.read_text())["track"]["frames"]


def test_deployments_in_the_emulated_cell_are_whole_episodes_in_pairs_and_are_made_once(program, tmp_path):
    arguments = ["study", "--out", "study", "--task", "place_tip", *SMALL]
    said = program.json(*arguments, "--cell", "emulated", folder=tmp_path, seconds=600)
    assert said["study"]["cell"] == "emulated"
    folder = tmp_path / "study/place_tip/deployments_emulated"
    made = {path.name: path for path in folder.iterdir()}
    assert set(made) == {f"{policy}_on_dlo_0_{number}.json" for policy in ("U", "mu", "dlo_0") for number in (1, 2)}
    for path in made.values():
        # Six actions and the last observation. The arm starts at its start pose and goes where the actions say.
        frames = frames_of(path)
        assert len(frames) == 7 and len(json.loads(path.read_text())["rewards"]) == 6
        assert abs(frames[0]["eef"][0] - 0.4) < 0.03 and abs(frames[0]["eef"][1] - 0.42) < 0.03
        # The bar hangs still below the hand, also after the episode of another policy: it leant by up to 0.2 while it swung.
        assert abs(frames[0]["dlo"][3][0] - frames[0]["dlo"][0][0]) < 0.07
        commanded = [sum(f["action"][i] for f in frames) for i in (0, 1)]
        moved = [frames[-1]["eef"][i] - frames[0]["eef"][i] for i in (0, 1)]
        assert max(abs(a - b) for a, b in zip(commanded, moved)) < 0.03, (commanded, moved)
    # All policies meet the same target in a deployment of one number, and another one in the next.
    targets = {name: frames_of(path)[0]["target"] for name, path in made.items()}
    apart = lambda a, b: max(abs(p - q) for p, q in zip(targets[a], targets[b]))
    assert all(apart(f"U_on_dlo_0_{n}.json", f"{other}_on_dlo_0_{n}.json") < 0.01 for n in (1, 2) for other in ("mu", "dlo_0"))
    assert apart("U_on_dlo_0_1.json", "U_on_dlo_0_2.json") > 0.01
    assert "with an emulated Panda" in (tmp_path / "study/report.html").read_text()
    # The same command only reads; without the cell, deployments in simulation are made beside those.
    written = {path: path.stat().st_mtime_ns for path in made.values()}
    program.json(*arguments, "--cell", "emulated", folder=tmp_path, seconds=600)
    # The policies are those for the arm of the bridge.
    said = program.json(*arguments, "--arm", "emulated", folder=tmp_path, seconds=600)
    assert said["study"]["cell"] is None and {path: path.stat().st_mtime_ns for path in made.values()} == written
    assert len(list((tmp_path / "study/place_tip/deployments").iterdir())) == 3 * 2 * 2


def test_a_task_with_a_rest_runs_on_the_graph_and_a_stopped_study_goes_on(program, tmp_path):
    arguments = ["study", "--out", "study", "--task", "settle", *SMALL, "--cell", "sim"]
    stopped = program.start(*arguments, folder=tmp_path)
    folder = tmp_path / "study/settle/deployments_sim"
    deadline = time.monotonic() + 300
    while not list(folder.glob("*.json")) and time.monotonic() < deadline:
        time.sleep(0.1)
    stopped.send_signal(signal.SIGINT)
    said = stopped.communicate(timeout=60)[1]
    assert "to go on: the same command" in said, said
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*.json")}
    assert 0 < len(before) < 6
    program.json(*arguments, folder=tmp_path, seconds=600)
    assert len(list(folder.iterdir())) == 6 and all(path.stat().st_mtime_ns == written for path, written in before.items())
    # 4 actions and 16 steps of rest, in which the arm is told its target again and stays there.
    for path in folder.iterdir():
        frames = frames_of(path)
        assert len(frames) == 21 and abs(frames[-1]["eef"][0] - frames[8]["eef"][0]) < 0.01
