"""`catenary study` compares policies that know the object with others. Parts of it give what the whole gives, to the bit."""

import time

import pytest

from support.program import ROOT

SMALL = [
    "--objects",
    "dlo_0",
    "dlo_2",
    "--seeds",
    2,
    "--steps",
    768,
    "--history",
    2,
    "--no-plan",
    "--episodes",
    4,
    "--repeats",
    2,
    "--evidence",
    "1:2x40",
    "2:1x30",
]


@pytest.fixture(scope="module")
def whole(program, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    answer = program.json("study", "--out", "whole", "--task", "place_tip", "settle", *SMALL, folder=folder, seconds=600)
    return folder, answer["study"]


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_every_policy_is_scored_on_every_object_and_compared(whole):
    folder, study = whole
    assert [task["task"] for task in study["tasks"]] == ["place_tip", "settle"]
    for task in study["tasks"]:
        named = ["U", "mu", "dlo_0", "dlo_2", "true dlo_0", "true dlo_2", "dlo_0+2:1x30", "dlo_2+2:1x30"]
        assert [p["policy"] for p in task["policies"]] == named
        for policy in task["policies"]:
            assert [len(trainings) for trainings in policy["mean_returns"]] == [2, 2]
        own = {p["policy"]: p["mean_returns"] for p in task["policies"]}
        for number, (name, other) in enumerate([("dlo_0", "dlo_2"), ("dlo_2", "dlo_0")]):
            gains = {g["against"]: g for g in task["objects"][number]["gains"]}
            # Of two trainings no value is left out: the interquartile mean is the mean.
            mean = sum(own[name][number]) / 2
            assert gains["U"]["gain"]["value"] == pytest.approx(mean - sum(own["U"][number]) / 2)
            assert gains["mismatched"]["gain"]["value"] == pytest.approx(mean - sum(own[other][number]) / 2)
            first, more = (e["objects"][number]["gain"]["value"] for e in task["evidence"])
            assert first == gains["U"]["gain"]["value"]
            assert more == pytest.approx(sum(own[f"{name}+2:1x30"][number]) / 2 - sum(own["U"][number]) / 2)
            # Two trainings cannot refute equality: two of four sign changes are as far from zero.
            assert gains["U"]["p"] >= 0.5 and gains["U"]["gain"]["low"] <= gains["U"]["gain"]["value"] <= gains["U"]["gain"]["high"]
        # Eight pairs of one sign are needed.
        assert {pairs["decision"] for pairs in task["deployments"]} == {"hopeless"}
    assert [len(o["posteriors"]) for o in study["objects"]] == [2, 2]
    assert all(p["information_nat"] > 0 for o in study["objects"] for p in o["posteriors"])
    page = (folder / "whole/report.html").read_text()
    assert page.count("<figure") >= 18 and "NaN" not in page and "(so few trainings cannot reach that)" in page
    assert "Task place_tip" in page and "time warping" in page
    assert "What evidence is worth in settle" in page and "2 recordings, 30 simulations" in page
    assert "newest observation, the time, and 2 before it" in page


def test_parts_make_the_same_bits_and_a_killed_part_goes_on(whole, program, tmp_path):
    folder, _ = whole
    arguments = ["study", "--out", tmp_path / "parts", "--task", "place_tip", "settle", *SMALL]
    killed = program.start(*arguments, "--part", "1/2")
    deadline = time.monotonic() + 120
    while not list((tmp_path / "parts").rglob("scores/*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    killed.kill()
    killed.communicate()
    for part in ("2/2", "1/2"):
        said = program.json(*arguments, "--part", part, folder=tmp_path, seconds=600)
        assert said["part"] == part and "study" not in said
    assert not (tmp_path / "parts/report.html").exists()
    program.json(*arguments, folder=tmp_path, seconds=600)
    ours = {path: data for path, data in files(tmp_path / "parts").items() if ".unfinished" not in path.name}
    assert ours == files(folder / "whole")


def test_other_arguments_in_the_same_folder_and_wrong_ones_are_refused(whole, program):
    folder, _ = whole
    arguments = ["study", "--out", "whole", "--task", "place_tip", "settle", *SMALL]
    for changed, says in [
        (["--seed", 2], ["plan.json", "seed", "expected 2", "got 1"]),
        (["--part", "3/2"], ["--part", "I/N"]),
    ]:
        done = program(*arguments, *changed, folder=folder)
        assert done.returncode == 2 and all(part in done.stderr for part in says), done.stderr
    bar = (ROOT / "launch_configs/models/dlo_0.yaml").read_text()
    (folder / "other").write_text(bar.replace("density_kg_m3: 1055.0", "density_kg_m3: 900.0"))
    (folder / "named").write_text(bar.replace("name: dlo_0", "name: true_bar"))
    for arguments, says in [
        (["--task", "setle"], ["task setle", "shipped tasks are", "settle"]),
        (["--objects", "soft_bar"], ["--objects soft_bar", "nominal value of length_m"]),
        (["--objects", "dlo_0", "dlo_0"], ["dlo_0", "twice"]),
        (["--objects", "other"], ["--objects other", "parameters", "soft_bar"]),
        (["--objects", "named"], ["--objects named", "true_bar", "name of letters"]),
        (["--steps", 0], ["--steps", "total_steps", "0"]),
        (["--history", 65], ["--history", "at most 64", "65"]),
        (["--evidence", "1:0x40"], ["--evidence", "iterations", "0"]),
        (["--evidence", "1", "1:15x100"], ["--evidence 1:15x100", "twice"]),
        (["--model", "measured_cable"], ["measured_cable", "no task"]),
    ]:
        done = program("study", "--out", "new", *arguments, folder=folder)
        assert done.returncode == 2 and all(part in done.stderr for part in says), done.stderr
        assert not (folder / "new/plan.json").exists()


def test_a_study_may_do_without_mu_and_told_policies_and_makes_damaged_files_again(program, tmp_path):
    arguments = ["study", "--out", "few", "--task", "place_tip", "--objects", "dlo_0", "--seeds", 2, "--steps", 768, "--episodes", 4]
    arguments += ["--repeats", 1, "--evidence", "1:2x40", "--policies"]
    study = program.json(*arguments, folder=tmp_path, seconds=300)["study"]
    task = study["tasks"][0]
    assert [p["policy"] for p in task["policies"]] == ["U", "dlo_0"]
    # Nothing but U is left to compare with.
    assert [g["against"] for g in task["all"]] == ["U"]
    page = (tmp_path / "few/report.html").read_text()
    assert "NaN" not in page and ">mu<" not in page and ">true<" not in page
    for damaged, lost in [
        ("trainings/U_1.safetensors", "deployments/U_on_dlo_0_1.json"),
        ("trainings/U_1.curve.json", "scores/U_1.json"),
    ]:
        folder = tmp_path / "few/place_tip"
        whole = (folder / damaged).read_bytes()
        (folder / damaged).write_bytes(b"{")
        (folder / lost).unlink()
        done = program(*arguments, folder=tmp_path)
        assert done.returncode != 0 and damaged in done.stderr and "remove it, and it is made again" in done.stderr, done.stderr
        (folder / damaged).unlink()
        assert program.json(*arguments, folder=tmp_path, seconds=300)["study"] == study
        assert (folder / damaged).read_bytes() == whole


def test_a_task_and_a_policy_of_another_one_are_refused(program, tmp_path):
    program.json(
        "train",
        "--model",
        "soft_bar",
        "--task",
        "whip",
        "--steps",
        768,
        "--no-plan",
        "--out",
        "whip.safetensors",
        folder=tmp_path,
        seconds=300,
    )
    done = program("evaluate", "--model", "soft_bar", "--task", "place_tip", "--policy", "whip.safetensors", folder=tmp_path)
    assert done.returncode == 2 and "whip.safetensors" in done.stderr and "trained for the goal `whip`" in done.stderr, done.stderr
    scored = program.json(
        "evaluate", "--model", "soft_bar", "--task", "whip", "--policy", "whip.safetensors", "--episodes", 30, folder=tmp_path
    )
    assert len(scored["policies"][0]["returns"]) == 30
