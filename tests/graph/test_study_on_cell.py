"""`catenary study --cell` deploys on the whole graph, in a DDS domain of its own, with a cell that holds the hidden object."""

import json

SMALL = ["--objects", "dlo_0", "--seeds", 2, "--steps", 768, "--episodes", 4, "--repeats", 2, "--evidence", "1:2x40"]


def test_deployments_in_the_emulated_cell_are_whole_episodes_and_are_made_once(program, tmp_path):
    arguments = ["study", "--out", "study", "--task", "place_tip", *SMALL]
    said = program.json(*arguments, "--cell", "emulated", folder=tmp_path, seconds=600)
    assert said["study"]["cell"] == "emulated"
    folder = tmp_path / "study/place_tip/deployments_emulated"
    made = {path.name: path for path in folder.iterdir()}
    assert set(made) == {f"{policy}_on_dlo_0_{number}.json" for policy in ("U", "mu", "dlo_0") for number in (1, 2)}
    for path in made.values():
        deployment = json.loads(path.read_text())
        frames = deployment["track"]["frames"]
        # Six actions and the last observation. The arm starts at its start pose and goes where the actions say.
        assert len(frames) == 7 and len(deployment["rewards"]) == 6
        assert abs(frames[0]["eef"][0] - 0.4) < 0.03 and abs(frames[0]["eef"][1] - 0.42) < 0.03
        commanded = [sum(f["action"][i] for f in frames) for i in (0, 1)]
        moved = [frames[-1]["eef"][i] - frames[0]["eef"][i] for i in (0, 1)]
        assert max(abs(a - b) for a, b in zip(commanded, moved)) < 0.03, (commanded, moved)
    assert "with an emulated Panda" in (tmp_path / "study/report.html").read_text()
    # The same command only reads; without the cell, deployments in simulation are made beside those.
    written = {path: path.stat().st_mtime_ns for path in made.values()}
    program.json(*arguments, "--cell", "emulated", folder=tmp_path, seconds=600)
    said = program.json(*arguments, folder=tmp_path, seconds=600)
    assert said["study"]["cell"] is None and {path: path.stat().st_mtime_ns for path in made.values()} == written
    assert len(list((tmp_path / "study/place_tip/deployments").iterdir())) == 3 * 2 * 2
